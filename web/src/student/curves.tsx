// Small plots without interaction: figures of the papers for the setting, and reachable twists.

import type { PaperFigure, StudentFigures, StudentOutline } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { decimalsOf } from "./equations";

const [WIDTH, HEIGHT] = [220, 130];
const LEFT = 44;
const BOTTOM = 34;
const DASHES = ["", "6 3", "2 3", "8 3 2 3"];

type Range = readonly [number, number];

/** Range of values and zero, never empty. */
export function rangeOf(values: readonly number[]): Range {
  const least = Math.min(0, ...values);
  const most = Math.max(0, ...values);
  return most > least ? [least, most] : [least, least + 1];
}

function pathOf(
  x: readonly number[],
  y: readonly number[],
  [rx, ry]: [Range, Range],
  dots = false,
) {
  const right = (value: number) => LEFT + ((value - rx[0]) / (rx[1] - rx[0])) * (WIDTH - LEFT - 6);
  const down = (value: number) => 6 + ((ry[1] - value) / (ry[1] - ry[0])) * (HEIGHT - BOTTOM - 6);
  return x
    .map((value, i) => {
      const at = `${right(value).toFixed(1)} ${down(y[i] ?? 0).toFixed(1)}`;
      return dots ? `M${at}h.01` : `${i === 0 ? "M" : "L"}${at}`;
    })
    .join("");
}

interface AxesProps {
  ranges: [Range, Range];
  x: string;
  y: string;
}

function Axes({ ranges, x, y }: AxesProps) {
  const bottom = HEIGHT - BOTTOM;
  const ends = (range: Range) => {
    const decimals = Math.min(2, decimalsOf(Math.max(...range.map(Math.abs))));
    return range.map((value) => figure(value, decimals));
  };
  const [[x0, x1], [y0, y1]] = [ends(ranges[0]), ends(ranges[1])];
  return (
    <>
      <path class="frame" d={`M${LEFT} 6V${bottom}H${WIDTH - 6}`} />
      <text x={LEFT} y={bottom + 13}>
        {x0}
      </text>
      <text class="end" x={WIDTH - 6} y={bottom + 13}>
        {x1}
      </text>
      <text class="across" x={(LEFT + WIDTH) / 2} y={bottom + 27}>
        {x}
      </text>
      <text class="end" x={LEFT - 4} y={bottom}>
        {y0}
      </text>
      <text class="end" x={LEFT - 4} y={14}>
        {y1}
      </text>
      <text class="across" transform={`translate(10 ${bottom / 2}) rotate(-90)`}>
        {y}
      </text>
    </>
  );
}

const labelled = (name: string, unit: string) => (unit ? `${name} (${unit})` : name);

export function PaperPlot({ paper }: { paper: PaperFigure }) {
  const { student } = texts();
  const ranges: [Range, Range] = [
    rangeOf(paper.curves.flatMap(({ x }) => x)),
    rangeOf(paper.curves.flatMap(({ y }) => y)),
  ];
  const title = student.papers[paper.name] ?? paper.name.replaceAll("_", " ");
  const labels = paper.curves.map(({ label }) => label).join(", ");
  return (
    <figure class="curves">
      <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={title}>
        <Axes
          ranges={ranges}
          x={labelled(paper.x, paper.x_unit)}
          y={labelled(paper.y, paper.y_unit)}
        />
        {paper.curves.map(({ x, y, points }, i) => (
          <path
            key={i}
            class={points ? "points" : "line"}
            stroke-dasharray={points ? undefined : DASHES[i % DASHES.length]}
            d={pathOf(x, y, ranges, points)}
          />
        ))}
      </svg>
      <figcaption>
        {title}
        <span class="note">
          {student.source(paper.paper, paper.figure, false)}
          {paper.curves.length > 1 && `: ${labels}`}
        </span>
      </figcaption>
    </figure>
  );
}

interface ReachPlotProps {
  outline: StudentOutline;
  figures: StudentFigures;
}

/** Reachable twists in two components: filled without the third one, a line with any. */
export function ReachPlot({ outline, figures }: ReachPlotProps) {
  const { student } = texts();
  const [a, b] = outline.axes.map((axis) => figures.axes[axis]);
  if (!a || !b) return null;
  const all = [...outline.section, ...outline.shadow];
  const ranges: [Range, Range] = [rangeOf(all.map(([x]) => x)), rangeOf(all.map(([, y]) => y))];
  const closed = (points: readonly Range[]) => {
    const [x, y] = [points.map(([first]) => first), points.map(([, second]) => second)];
    return `${pathOf(x, y, ranges)}Z`;
  };
  return (
    <figure class="curves">
      <svg
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        role="img"
        aria-label={student.reach(a.symbol, b.symbol)}
      >
        <Axes ranges={ranges} x={labelled(a.symbol, a.unit)} y={labelled(b.symbol, b.unit)} />
        <path class="section" d={closed(outline.section)} />
        <path class="shadow" d={closed(outline.shadow)} />
      </svg>
    </figure>
  );
}
