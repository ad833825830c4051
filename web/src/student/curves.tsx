// Small plots without interaction: figures of the papers for the setting, and reachable twists.

import type { PaperFigure, StudentOutline, TwistAxisInfo } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { decimalsOf } from "./equations";

const DASHES = ["", "6 3", "2 3", "8 3 2 3"];

interface Plot {
  title: string;
  /** Names of the axes. */
  x: string;
  y: string;
  curves: readonly {
    look: "line" | "points" | "section" | "shadow";
    points: readonly (readonly [number, number])[];
  }[];
  source?: string;
}

const labelled = (name: string, unit: string) => (unit ? `${name} (${unit})` : name);

export function paperPlot({ name, paper, figure, curves, ...axes }: PaperFigure): Plot {
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
    source: student.source(paper, figure, false) + (curves.length > 1 ? `: ${labels}` : ""),
  };
}

/** Reachable twists in two components: filled without the third one, a line with any. */
export function reachPlot(outline: StudentOutline, axes: readonly TwistAxisInfo[]): Plot {
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

export function PlotFigure({ title, x, y, curves, source }: Plot) {
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
