// What follows from the setting: equations with their values and sources, figures, and small plots.

import { type ComponentChild, h } from "preact";
import type * as wire from "../generated/wire";
import { figure, texts } from "../text/text";
import { Fold } from "../ui/fold";

export function Equations({ equations }: wire.StudentFigures) {
  const { student } = texts();
  return (
    <div class="eqs">
      {equations.map(({ name, formula, values, units, paper, equation, corrected }) => {
        const meaning = student.equations[name] ?? name.replaceAll("_", " ");
        const unit = [...new Set(units)].filter(Boolean).join(", ");
        return (
          <div key={name}>
            <math class="f">{formula.map(mathOf)}</math>
            <output>{values.map((value) => figure(value, decimalsOf(value))).join(" · ")}</output>
            <p class="note">
              {unit ? `${unit}: ${meaning}` : meaning}
              {paper && ` (${student.source(paper, equation, corrected)})`}
            </p>
          </div>
        );
      })}
    </div>
  );
}

/** Decimals for three or four digits. */
export function decimalsOf(value: number | null): number {
  const size = Math.abs(value ?? 0);
  return size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 || size === 0 ? 2 : 3;
}

function mathOf({ kind, text, sub, sup, rows }: wire.MathToken): ComponentChild {
  if (rows) return h(kind, null, ...rows.map((row) => h("mrow", null, ...row.map(mathOf))));
  const base = h(kind, kind === "mi" ? { mathvariant: "normal" } : null, text);
  const [below, above] = [sub && h("mi", null, sub), sup && h("mn", null, sup)];
  if (below && above) return h("msubsup", null, base, below, above);
  if (below) return h("msub", null, base, below);
  return above ? h("msup", null, base, above) : base;
}

/** Utilization of the joint limits, and the largest twist in the same direction. */
export function outcome({ axes, twist, utilization: share }: wire.StudentFigures): string {
  const { student } = texts();
  if (share === 0) return student.atRest;
  const most = axes.map(({ symbol, unit }, i) => {
    const part = ((twist[i] ?? 0) * Math.max(1, share)) / share;
    return `${symbol} ${figure(part, 2)} ${unit}`;
  });
  return `${student.share(figure(100 * share), share > 1)} ${student.most(most.join(", "))}`;
}

export function Capabilities({ figures, outlines, axes }: wire.StudentFigures) {
  const { student } = texts();
  return (
    <Fold title={student.figures}>
      <dl class="results">
        {figures.map(({ name, value, unit, note }) => (
          <div key={name}>
            <dt>
              {student.labels[name] ?? name} {note && <span class="note">{note}</span>}
            </dt>
            <dd>
              {figure(value, decimalsOf(value))}
              <span class="u">{unit}</span>
            </dd>
          </div>
        ))}
      </dl>
      <p class="note">{student.reachHint}</p>
      <div class="plots-row">
        {outlines.map((outline, i) => (
          <PlotFigure key={i} {...reachPlot(outline, axes)} />
        ))}
      </div>
    </Fold>
  );
}

export function Papers({ papers }: wire.StudentReply) {
  return (
    <Fold title={texts().student.paperFigures}>
      <div class="plots-row">
        {papers.map((paper) => (
          <PlotFigure key={paper.name} {...paperPlot(paper)} />
        ))}
      </div>
    </Fold>
  );
}

const DASHES = ["", "6 3", "2 3", "8 3 2 3"];

interface Plot {
  title: string;
  x: string;
  y: string;
  curves: readonly {
    look: "line" | "points" | "section" | "shadow";
    points: readonly (readonly [number, number])[];
  }[];
  source?: string;
}

const labelled = (name: string, unit: string) => (unit ? `${name} (${unit})` : name);

function paperPlot({ name, paper, figure: number, curves, ...axes }: wire.PaperFigure): Plot {
  const { student } = texts();
  const labels = curves.map(({ label }) => label).join(", ");
  return {
    title: student.papers[name] ?? name.replaceAll("_", " "),
    x: labelled(axes.x, axes.x_unit),
    y: labelled(axes.y, axes.y_unit),
    curves: curves.map(({ x, y, points }) => ({
      look: points ? "points" : "line",
      points: x.map((across, i) => [across, y[i] ?? 0]),
    })),
    source: student.source(paper, number, false) + (curves.length > 1 ? `: ${labels}` : ""),
  };
}

/** Reachable twists in two components: filled without the third one, a line with any. */
function reachPlot(outline: wire.StudentOutline, axes: wire.StudentFigures["axes"]): Plot {
  const [x, y] = [axes[outline.axes[0]]!, axes[outline.axes[1]]!];
  return {
    title: texts().student.reach(x.symbol, y.symbol),
    x: labelled(x.symbol, x.unit),
    y: labelled(y.symbol, y.unit),
    curves: [
      { look: "section", points: outline.section },
      { look: "shadow", points: outline.shadow },
    ],
  };
}

function PlotFigure({ title, x, y, curves, source }: Plot) {
  const points = curves.flatMap((curve) => curve.points);
  const [left, right] = rangeOf(points.map(([across]) => across));
  const [bottom, top] = rangeOf(points.map(([, up]) => up));
  return (
    <figure class="curves">
      <div class="plot" role="img" aria-label={title}>
        <Axis way="y" name={y} ends={[bottom, top]} />
        <svg viewBox={`${left} ${-top} ${right - left} ${top - bottom}`} preserveAspectRatio="none">
          {curves.map(({ look, points }, i) => {
            const line = `M${points.map((point) => point.join(" ")).join("L")}`;
            const dots = points.map((point) => `M${point.join(" ")}h0`).join("");
            const d = { line, points: dots, section: line, shadow: `${line}Z` }[look];
            const dashes = look === "line" ? DASHES[i % DASHES.length] : undefined;
            return <path class={look} d={d} stroke-dasharray={dashes} transform="scale(1 -1)" />;
          })}
        </svg>
        <Axis way="x" name={x} ends={[left, right]} />
      </div>
      {source && (
        <figcaption>
          {title}
          <span class="note">{source}</span>
        </figcaption>
      )}
    </figure>
  );
}

/** Range of values and zero, never empty. */
function rangeOf(values: readonly number[]): [number, number] {
  const [least, most] = [Math.min(0, ...values), Math.max(0, ...values)];
  return [least, most > least ? most : least + 1];
}

function Axis({ way, name, ends }: { way: "x" | "y"; name: string; ends: [number, number] }) {
  const decimals = Math.min(2, decimalsOf(Math.max(...ends.map(Math.abs))));
  return (
    <div class={way}>
      <span class="name">{name}</span>
      <span class="least">{figure(ends[0], decimals)}</span>
      <span>{figure(ends[1], decimals)}</span>
    </div>
  );
}
