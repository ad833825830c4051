// One plot: a uPlot canvas for fields of a buffer, and a legend with values.

import { el, setText } from "./dom.js";
import { fixed } from "./format.js";
import { decimalsOf } from "./plot_fields.js";

const GUTTER_PX = 42;
const HEIGHT_PX = 78;
const AXIS_PX = 26;
const EDGE_PX = 14; // Half of the last time label.
const GAP_S = 0.3; // Longer gaps interrupt the line.
const ROUND = [1, 2, 5, 10];
const TONES = ["one", "two", "three", "four"];
const STYLES = {
  set: { width: 1, dash: [] },
  measured: { width: 2.25, dash: [] },
  other: { width: 1.5, dash: [5, 3] },
};
/** @type {Record<string, number>} Minimum end of the value axis, by title. */
const LEAST = { Velocity: 0.2, "Turn rate": 0.5, Tilt: 5, Rpm: 20, "Link round trip": 20 };
const LEAST_OF_ALL = 0.02;

export class PlotChart {
  /**
   * @param {typeof import("uplot")} Library @param {import("./plot_buffer.js").PlotBuffer} buffer
   * @param {PlotField[]} fields @param {PlotView} view @param {boolean} isLast
   */
  constructor(Library, buffer, fields, view, isLast) {
    this.fields = fields;
    this._buffer = buffer;
    this._view = view;
    this._isLast = isLast; // It shows the time axis.
    this._topEnd = 0;
    this._values = fields.map(() => el("span.value"));
    const parts = [...new Set(fields.map(({ part }) => part))];
    this.legend = fields.map(({ name, part, line }, i) => {
      const tone = TONES[parts.indexOf(part) % TONES.length];
      const attributes = { class: `series ${tone} ${line}`, title: name };
      const label = line === "other" ? `${name.split(".")[0]} ${part}` : part;
      return el("span", attributes, el("i"), label, " ", this._values[i]);
    });
    const [{ title, unit }] = fields;
    this._place = el("div", { role: "img", "aria-label": `${title}, ${unit}` });
    const legend = el("span.legend", ...this.legend);
    const head = el("div.head", el("strong", title), el("span.unit", unit), legend);
    this.element = el("figure.chart", head, this._place);
    this._range = Library.rangeNum;
    this.plot = new Library(this._options(), this._data(), this._place);
  }

  draw() {
    const { clientWidth: width } = this._place;
    if (this.plot.width !== width) this.plot.setSize({ width, height: this.plot.height });
    this.plot.setData(this._data());
  }

  /** Show the values at a buffer index. @param {number} at */
  show(at) {
    this.fields.forEach((field, i) =>
      setText(this._values[i], fixed(this._buffer.values(field.name)[at], decimalsOf(field))),
    );
  }

  /** @returns {import("uplot").AlignedData} */
  _data() {
    return [this._buffer.times, ...this.fields.map(({ name }) => this._buffer.values(name))];
  }

  /** @returns {import("uplot").Options} */
  _options() {
    // Read at each draw, because colours may change.
    const style = getComputedStyle(this._place);
    const axis = {
      stroke: () => style.color,
      font: "11px system-ui, sans-serif",
      grid: { stroke: () => style.borderTopColor, width: 1 },
      ticks: { show: false },
    };
    return {
      width: 2 * GUTTER_PX, // Until the first draw.
      height: HEIGHT_PX + (this._isLast ? AXIS_PX : 0),
      padding: [7, EDGE_PX, this._isLast ? 0 : 7, 0],
      legend: { show: false },
      cursor: {
        y: false,
        drag: { x: false, y: false },
        sync: { key: "tsd-plots" },
        bind: { dblclick: () => null },
      },
      scales: {
        x: { time: false, range: () => this._view.span() },
        y: { range: () => this._valueRange() },
      },
      axes: [
        {
          ...axis,
          size: this._isLast ? AXIS_PX : 0,
          gap: 7, // Below the lowest number of the other axis.
          splits: (_plot, _axis, fromS, toS, stepS) => this._view.splits(fromS, toS, stepS),
          values: (_plot, at) => at.map((s) => (this._isLast ? this._view.timeText(s) : "")),
        },
        { ...axis, size: GUTTER_PX, gap: 4, space: 24, values: (_plot, at) => at.map(tick) },
      ],
      series: [
        {},
        ...this.fields.map(({ line }, i) => ({
          ...STYLES[line],
          stroke: () => getComputedStyle(this.legend[i]).color,
          points: { show: false },
          gaps: gapsOf,
        })),
      ],
      hooks: { setCursor: [({ cursor }) => this._view.onCursor(cursor.idx ?? null)] },
    };
  }

  /**
   * Range of the value axis: includes zero unless values are far from it, ends at a round number,
   * and shrinks only if there is ample room.
   * @returns {[number, number]}
   */
  _valueRange() {
    const least = LEAST[this.fields[0].title] ?? LEAST_OF_ALL;
    const [from, to] = this._buffer.places(...this._view.span());
    let [low, high] = [Infinity, -Infinity];
    for (const { name } of this.fields) {
      for (const value of this._buffer.values(name).subarray(from, to)) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    if (low > high / 2 && high > least) {
      const [bottom, top] = this._range(low, high, 0.1, true);
      return [bottom ?? low, top ?? high];
    }
    const most = Math.max(least, -low, high);
    const power = 10 ** Math.floor(Math.log10(most));
    const round = power * (ROUND.find((step) => power * step >= most * 0.999) ?? NaN);
    if (round > this._topEnd || most < 0.4 * this._topEnd) this._topEnd = round;
    return [low < 0 ? -this._topEnd : 0, this._topEnd];
  }
}

/**
 * Return the ranges without data, in canvas pixels.
 * @type {(plot: import("uplot"), series: number, from: number, to: number) => [number, number][]}
 */
function gapsOf(plot, series, from, to) {
  const [times, values] = [plot.data[0], plot.data[series]];
  /** @type {[number, number][]} */
  const gaps = [];
  let before = from;
  for (let i = from; i <= to; i += 1) {
    if (Number.isNaN(values[i])) continue;
    if (times[i] - times[before] > GAP_S)
      gaps.push([plot.valToPos(times[before], "x", true), plot.valToPos(times[i], "x", true)]);
    before = i;
  }
  return gaps;
}

/** @param {number} value */
export function tick(value) {
  const text = Number(Math.abs(value).toPrecision(6)).toString();
  return value < 0 ? `\u2212${text}` : text;
}
