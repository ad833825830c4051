// One plot: a uPlot canvas for fields of a buffer.

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { language } from "../text/text";
import type { PlotBuffer } from "./buffer";
import type { PlotField } from "./fields";
import type { PlotView } from "./view";

const GUTTER_PX = 46;
const HEIGHT_PX = 104;
const AXIS_PX = 26;
const EDGE_PX = 18; // Half of the last time label.
const LEAST_RANGE = 50; // Smallest range of a value axis, in steps of the last shown decimal.
const GAP_S = 0.3; // Longer gaps interrupt the line.
const WIDTHS = { set: 1, measured: 2.25, other: 1.5 };
/** Each part of a plot has a hue and a pattern, so that colour is not the only difference. */
const HUES = ["--estimate", "--plan", "--command", "--caution", "--ink-2"];
const PATTERNS = [[], [9, 4], [2, 3], [9, 3, 2, 3], [5, 3]];
type Range = [number, number];

/** Styles of the lines of a plot; set-point and measured value differ by width only. */
export function stylesOf(fields: readonly PlotField[]) {
  const key = ({ part, line, unit }: PlotField) => `${part} ${unit} ${line === "other"}`;
  const parts = [...new Set(fields.map(({ part }) => part))];
  const keys = [...new Set(fields.map(key))];
  return fields.map((field) => ({
    hue: HUES[parts.indexOf(field.part) % HUES.length]!,
    dash: PATTERNS[keys.indexOf(key(field)) % PATTERNS.length]!,
    width: WIDTHS[field.line],
  }));
}

/** All charts of the page; they share a cursor. */
const group = uPlot.sync("tsd-plots");

export function drawCharts(buffer: PlotBuffer): void {
  for (const plot of group.plots) {
    const { clientWidth: width } = plot.root.parentElement!;
    if (width === 0) continue;
    if (plot.width !== width) plot.setSize({ width, height: plot.height });
    const names = plot.series.slice(1).map(({ label }) => label as string);
    plot.setData([buffer.times, ...names.map((name) => buffer.values(name))]);
  }
}

/** Return the position of a pointer on the charts, as a fraction of their width. */
export function shareOf({ clientX }: MouseEvent): number {
  const { left, width } = group.plots[0]!.over.getBoundingClientRect();
  return (clientX - left) / width;
}

/** Move the cursor of all charts, by default from the middle. */
export function moveCursor(pixels: number): void {
  for (const plot of group.plots) {
    const { left = -1 } = plot.cursor;
    const { width } = plot.over.getBoundingClientRect();
    const to = left < 0 ? width / 2 : Math.max(0, Math.min(width - 1, left + pixels));
    plot.setCursor({ left: to, top: 0 });
  }
}

/** Make the chart of fields in an element; only the last one of a page has a time axis. */
export function newChart(
  place: HTMLElement,
  fields: readonly PlotField[],
  view: PlotView,
  isLast: boolean,
): uPlot {
  const units = [...new Set(fields.map(({ unit }) => unit))];
  const styles = stylesOf(fields);
  const { fontSize, fontFamily } = getComputedStyle(place);
  // Read at each draw, because colours may change.
  const colour = (token: string) => () => getComputedStyle(place).getPropertyValue(token);
  const grid = { stroke: colour("--line"), width: 1 };
  const axis = {
    stroke: colour("--ink-3"),
    font: `${fontSize} ${fontFamily}`,
    ticks: { show: false },
  };
  const timeAxis: uPlot.Axis = {
    ...axis,
    grid,
    size: isLast ? AXIS_PX : 0,
    gap: 7, // Below the lowest number of the other axis.
    space: 76,
    splits: (_plot, _axis, fromS, toS, stepS) => view.splits(fromS, toS, stepS),
    values: (_plot, at) => at.map((s) => (isLast ? view.timeText(s) : "")),
  };
  const valueAxis = (unit: string, i: number): uPlot.Axis => ({
    ...axis,
    grid: i === 0 ? grid : { show: false },
    scale: `y ${unit}`,
    side: i === 0 ? 3 : 1,
    size: GUTTER_PX,
    gap: 4,
    space: 24,
    values: (_plot, at) => at.map(tick),
  });
  const line = ({ name, unit }: PlotField, i: number): uPlot.Series => ({
    label: name,
    scale: `y ${unit}`,
    width: styles[i]!.width,
    dash: styles[i]!.dash,
    stroke: colour(styles[i]!.hue),
    points: { show: false },
    gaps: gapsOf,
  });
  const scale = (unit: string): [string, uPlot.Scale] => {
    const own = fields.filter((field) => field.unit === unit);
    const range: uPlot.Range.Function = (plot, _low, _high, key) =>
      rangeOf(view, own, plot.scales[key]!);
    return [`y ${unit}`, { range }];
  };
  const setCursor = ({ cursor: { left = -1 }, posToVal }: uPlot) => {
    view.cursorS.value = left < 0 ? null : posToVal(left, "x");
  };
  const options: uPlot.Options = {
    width: 2 * GUTTER_PX, // Until the first draw.
    height: HEIGHT_PX + (isLast ? AXIS_PX : 0),
    padding: [7, units.length > 1 ? 0 : EDGE_PX, isLast ? 0 : 7, 0],
    legend: { show: false },
    cursor: {
      y: false,
      drag: { x: false, y: false },
      sync: { key: group.key },
      points: { show: false },
    },
    scales: {
      x: { time: false, range: () => view.span() },
      ...Object.fromEntries(units.map(scale)),
    },
    axes: [timeAxis, ...units.map(valueAxis)],
    series: [{}, ...fields.map(line)],
    hooks: { setCursor: [setCursor] },
  };
  return new uPlot(options, [[], ...fields.map(() => [])], place);
}

/** Range of a value axis: with zero unless values are far from it; it shrinks only by much. */
function rangeOf(view: PlotView, fields: PlotField[], { min = 0, max = 0 }: uPlot.Scale): Range {
  const { buffer } = view.recorder;
  const [from, to] = buffer.places(...view.span());
  let [low, high] = [Infinity, -Infinity];
  for (const { name } of fields) {
    for (const value of buffer.values(name).subarray(from, to)) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (low > high) low = high = 0; // Without values.
  if (low < high / 2) low = Math.min(0, low);
  high = Math.max(high, low + LEAST_RANGE * 10 ** -fields[0]!.decimals);
  const fits = low >= min && high <= max && high - low > 0.4 * (max - min);
  return fits ? [min, max] : (uPlot.rangeNum(low, high, 0.1, true) as Range);
}

/** Return the ranges without data, in canvas pixels. */
function gapsOf(plot: uPlot, series: number, from: number, to: number): Range[] {
  const [times, values] = [plot.data[0], plot.data[series]!];
  const gaps: Range[] = [];
  let before = from;
  for (let i = from; i <= to; i += 1) {
    if (Number.isNaN(values[i])) continue;
    const [startS, endS] = [times[before]!, times[i]!];
    if (endS - startS > GAP_S)
      gaps.push([plot.valToPos(startS, "x", true), plot.valToPos(endS, "x", true)]);
    before = i;
  }
  return gaps;
}

function tick(value: number): string {
  const options = { maximumSignificantDigits: 6, useGrouping: false };
  return value.toLocaleString(language.peek(), options).replace("-", "−");
}
