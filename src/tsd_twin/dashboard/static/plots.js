// Plots tab: recorder of the last 20 s, line chart, and the choice of signals.

import { el, isVisible, setText } from "./dom.js";
import { fixed } from "./format.js";
import { kindOf } from "./kinds.js";
import { known } from "./link.js";

// The last twenty seconds of what is plotted, kept from the moment the page is opened.
const SPAN_S = 20;
const MAX_SAMPLES = 1024;
const NO_VECTOR = [null, null, null];

export class Recorder {
  /** @param {Link} link */
  constructor(link) {
    this.times = new Float64Array(MAX_SAMPLES);
    /** @type {Map<string, Float64Array>} */
    this.rows = new Map(); // Name of a channel to its values, in the same places as the times.
    this.count = 0; // Samples so far; the newest is at (count - 1) modulo the length.
    /** @type {RobotInfo | null} */
    this.robot = null; // The one that is recorded.
    link.on("state", (state) => this._take(state, link));
    link.on("robot", (robot) => this._begin(robot));
  }

  get length() {
    return Math.min(this.count, MAX_SAMPLES);
  }

  /**
   * Call `each(time_s, value)` for a channel, oldest first, from a time on.
   * @param {string} channel @param {number} fromS
   * @param {(timeS: number, value: number) => void} each
   */
  each(channel, fromS, each) {
    const values = this.rows.get(channel);
    if (values === undefined) return;
    for (let i = this.count - this.length; i < this.count; i += 1) {
      const at = i % MAX_SAMPLES;
      if (this.times[at] >= fromS) each(this.times[at], values[at]);
    }
  }

  /** @param {string} channel */
  newest(channel) {
    return this.rows.get(channel)?.[(this.count - 1) % MAX_SAMPLES] ?? NaN;
  }

  /** @param {RobotInfo} robot */
  _begin(robot) {
    if (this.robot?.id !== robot.id) {
      this.count = 0;
      this.rows.clear();
    }
    this.robot = robot; // The same robot may have another description.
  }

  /** @param {RobotState} state @param {Link} link */
  _take(state, link) {
    if (this.robot === null) return;
    const at = this.count % MAX_SAMPLES;
    this.times[at] = performance.now() / 1000;
    const commanded = state.commanded ?? NO_VECTOR;
    const twist = state.twist ?? NO_VECTOR;
    this.robot.twist_axes.forEach(({ name }, i) => {
      this._put(`set ${name}`, at, commanded[i]);
      this._put(name, at, twist[i]);
    });
    this.robot.modules.forEach((name, i) => this._put(`tilt ${name}`, at, state.modules[i]?.tilt));
    this.robot.wheels.forEach((name, i) => {
      this._put(`set ${name}`, at, state.wheels[i]?.set_rpm);
      this._put(name, at, state.wheels[i]?.rpm);
    });
    this._put("models", at, state.sphere?.angle_deg);
    this._put("residual", at, state.status.consistency.residual_mps);
    this._put("latency", at, link.roundTripMs());
    this.count += 1;
  }

  /** @param {string} channel @param {number} at @param {number | null | undefined} value */
  _put(channel, at, value) {
    const values = this.rows.get(channel) ?? new Float64Array(MAX_SAMPLES).fill(NaN);
    this.rows.set(channel, values);
    values[at] = value ?? NaN;
  }
}

// One plot on a canvas: lines over the last twenty seconds, now at the right edge.
const GUTTER_PX = 34;
const HEIGHT_PX = 72;
const AXIS_PX = 16;
const GAP_S = 0.3; // A line is not drawn over what was not seen.
const STEPS = [1, 2, 5, 10];

class Chart {
  /**
   * @param {Recorder} recorder @param {HTMLCanvasElement} canvas
   * @param {{ lines: PlotLine[], least: number, isSigned: boolean, axis: boolean }} options
   */
  constructor(recorder, canvas, { lines, least, isSigned, axis }) {
    this._recorder = recorder;
    this._canvas = canvas;
    this._lines = lines;
    this._least = least;
    this._isSigned = isSigned;
    this._axis = axis;
    this._height = HEIGHT_PX + (axis ? AXIS_PX : 0);
    canvas.style.height = `${this._height}px`;
  }

  /** @param {number} nowS */
  draw(nowS) {
    const canvas = this._canvas;
    const [width, height, density] = [canvas.clientWidth, this._height, devicePixelRatio || 1];
    if (width < 2 * GUTTER_PX) return;
    if (canvas.width !== Math.round(width * density)) {
      canvas.width = Math.round(width * density);
      canvas.height = Math.round(height * density);
    }
    // In plain memory: a graphics card that is busy with the scene would keep this page waiting.
    const pen = known(canvas.getContext("2d", { willReadFrequently: true }));
    pen.setTransform(density, 0, 0, density, 0, 0);
    pen.clearRect(0, 0, width, height);
    const top = this._range(nowS);
    const bottom = this._isSigned ? -top : 0;
    /** @type {PixelScale} */
    const x = (timeS) => GUTTER_PX + ((timeS - nowS + SPAN_S) / SPAN_S) * (width - GUTTER_PX - 1);
    /** @type {PixelScale} */
    const y = (value) => 5 + ((top - value) / (top - bottom)) * (HEIGHT_PX - 10);
    const frame = { x, y, top, bottom, width, nowS };
    this._grid(pen, frame);
    pen.save();
    pen.beginPath();
    pen.rect(GUTTER_PX, 0, width - GUTTER_PX, HEIGHT_PX);
    pen.clip();
    for (const line of this._lines) this._line(pen, line, frame);
    pen.restore();
  }

  /**
   * Return the end of the value axis: a round number, that shrinks only when there is much room.
   * @param {number} nowS
   */
  _range(nowS) {
    let most = this._least;
    for (const { channel } of this._lines) {
      this._recorder.each(channel, nowS - SPAN_S, (_, value) => {
        if (Math.abs(value) > most) most = Math.abs(value);
      });
    }
    const power = 10 ** Math.floor(Math.log10(most));
    const round = power * (STEPS.find((step) => power * step >= most * 0.999) ?? NaN);
    if (this._top === undefined || round > this._top || most < 0.4 * this._top) this._top = round;
    return this._top;
  }

  /** @param {CanvasRenderingContext2D} pen @param {PlotFrame} frame */
  _grid(pen, { x, y, top, bottom, width, nowS }) {
    const style = getComputedStyle(this._canvas);
    pen.strokeStyle = style.borderTopColor;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let s = 0; s <= SPAN_S; s += 5) {
      const at = Math.round(x(nowS - s)) + (s === 0 ? -0.5 : 0.5);
      pen.moveTo(at, 5);
      pen.lineTo(at, HEIGHT_PX - 5);
    }
    const middle = (top + bottom) / 2;
    for (const value of [bottom, middle, top]) {
      pen.moveTo(GUTTER_PX, Math.round(y(value)) + 0.5);
      pen.lineTo(width, Math.round(y(value)) + 0.5);
    }
    pen.stroke();
    pen.fillStyle = style.color;
    pen.font = `11px ${style.fontFamily}`;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const value of [bottom, middle, top])
      pen.fillText(tick(value), GUTTER_PX - 6, Math.min(HEIGHT_PX - 6, Math.max(6, y(value))));
    if (!this._axis) return;
    pen.textBaseline = "alphabetic";
    for (let s = 0; s <= SPAN_S; s += 5) {
      pen.textAlign = s === 0 ? "right" : s === SPAN_S ? "left" : "center";
      pen.fillText(s === 0 ? "now" : `\u2212${s} s`, x(nowS - s), this._height - 3);
    }
  }

  /** @param {CanvasRenderingContext2D} pen @param {PlotLine} line @param {PlotFrame} frame */
  _line(pen, { channel, width, swatch }, { x, y, nowS }) {
    pen.strokeStyle = getComputedStyle(swatch).color;
    pen.lineWidth = width;
    pen.lineJoin = "round";
    pen.beginPath();
    let lastS = -Infinity;
    this._recorder.each(channel, nowS - SPAN_S - 1, (timeS, value) => {
      if (!Number.isFinite(value)) return;
      if (timeS - lastS > GAP_S) pen.moveTo(x(timeS), y(value));
      else pen.lineTo(x(timeS), y(value));
      lastS = timeS;
    });
    pen.stroke();
  }
}

/** @param {number} value */
function tick(value) {
  const text = Number(Math.abs(value).toPrecision(3)).toString();
  return value < 0 ? `\u2212${text}` : text;
}

// Plots: the last twenty seconds; what is commanded thin, what is estimated thick, same colour.
const FRAME_MS = 80;
const TONES = ["one", "two", "three", "four"];

/** @type {Record<string, number>} */
const LEAST = { "m/s": 0.2, "rad/s": 0.5 };
/** @type {PlotRow} */
const ROUND_TRIP = {
  title: "Round trip",
  unit: "ms",
  decimals: 0,
  least: 20,
  series: [["page to robot", "latency"]],
};

/** Plots of a twist, the components of one unit in one. @type {(robot: RobotInfo) => PlotRow[]} */
function twistPlots({ twist_axes: axes }) {
  return [...new Set(axes.map(({ unit }) => unit))].map((unit) => {
    const own = axes.filter((axis) => axis.unit === unit);
    return {
      title: unit === "m/s" ? "Velocity" : own.length > 1 ? "Turning" : "Turn rate",
      unit,
      decimals: 2,
      least: LEAST[unit],
      series: own.map(({ symbol, name }) => [symbol, name]),
      commanded: true,
    };
  });
}

export class Plots {
  /** @param {Recorder} recorder @param {ShadowRoot} place @param {AbortSignal} signal */
  constructor(recorder, place, signal) {
    this._recorder = recorder;
    this._robot = null;
    /** @type {{ chart: Chart, values: { node: Element, channel: string, decimals: number }[] }[]} */
    this._rows = [];
    this._place = el("div.plots");
    place.append(this._place);
    const timer = setInterval(() => this._draw(), FRAME_MS);
    signal.addEventListener("abort", () => clearInterval(timer));
  }

  _draw() {
    const { robot } = this._recorder;
    if (robot === null || !isVisible(this._place)) return;
    if (robot !== this._robot) this._build(robot);
    const nowS = performance.now() / 1000;
    for (const { chart, values } of this._rows) {
      chart.draw(nowS);
      for (const { node, channel, decimals } of values)
        setText(node, fixed(this._recorder.newest(channel), decimals));
    }
  }

  /** @param {RobotInfo} robot */
  _build(robot) {
    this._robot = robot;
    const plots = [...twistPlots(robot), ...kindOf(robot).plots(robot), ROUND_TRIP];
    const rows = plots.map((plot) => this._row(plot, plot === ROUND_TRIP));
    this._rows = rows;
    this._place.replaceChildren(
      el("p.key", el("span.thin"), "commanded", el("span.thick"), "estimated"),
      ...rows.map(({ element }) => element),
    );
  }

  /** @param {PlotRow} row @param {boolean} last */
  _row({ title, unit, decimals, series, commanded = false, least }, last) {
    const values = series.map(([, channel]) => ({ channel, decimals, node: el("span.value") }));
    const legend = values.map(({ node }, i) =>
      el("span", { class: `series ${TONES[i % TONES.length]}` }, el("i"), series[i][0], " ", node),
    );
    const label = `${title} over the last 20 seconds, ${unit}`;
    const canvas = el("canvas", { role: "img", "aria-label": label });
    const lines = values.flatMap(({ channel }, i) => [
      ...(commanded ? [{ channel: `set ${channel}`, width: 1, swatch: legend[i] }] : []),
      { channel, width: 2.25, swatch: legend[i] },
    ]);
    const options = { lines, least, isSigned: commanded, axis: last };
    const chart = new Chart(this._recorder, canvas, options);
    const key = el("span.legend", ...legend);
    const head = el("div.head", el("strong", title), el("span.unit", unit), key);
    return { element: el("figure.chart", head, canvas), chart, values };
  }
}
