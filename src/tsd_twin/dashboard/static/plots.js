// Plots tab: recorder of the last 20 s, line chart, and the choice of signals.

import { el, isVisible, setText } from "./dom.js";
import { fixed } from "./format.js";
import { known } from "./link.js";

// The last twenty seconds of what is plotted, kept from the moment the page is opened.
export const SPAN_S = 20;
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
    this.card = null; // Of the robot that is recorded.
    link.on("state", (state) => this._take(state, link));
    link.on("robot", (robot) => this._begin(robot));
  }

  get length() {
    return Math.min(this.count, MAX_SAMPLES);
  }

  /**
   * Call `each(time_s, value)` for a channel, oldest first, from a time on.
   * @param {string} channel
   * @param {number} fromS
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
    return this.count === 0
      ? NaN
      : (this.rows.get(channel)?.[(this.count - 1) % MAX_SAMPLES] ?? NaN);
  }

  /** @param {RobotInfo} robot */
  _begin(robot) {
    if (this.card?.id === robot.id) return;
    this.card = robot;
    this.count = 0;
    this.rows.clear();
  }

  /** @param {RobotState} state @param {Link} link */
  _take(state, link) {
    if (this.card === null) return;
    const at = this.count % MAX_SAMPLES;
    this.times[at] = performance.now() / 1000;
    const commanded = state.commanded ?? NO_VECTOR;
    const twist = state.twist ?? NO_VECTOR;
    this.card.numbers.forEach(({ name }, i) => {
      this._put(`set ${name}`, at, commanded[i]);
      this._put(name, at, twist[i]);
    });
    this.card.modules.forEach((name, i) => this._put(`tilt ${name}`, at, state.modules[i]?.tilt));
    this.card.wheels.forEach((name, i) => {
      this._put(`set ${name}`, at, state.wheels[i]?.set_rpm);
      this._put(name, at, state.wheels[i]?.rpm);
    });
    this._put("models", at, state.ball?.angle_deg);
    this._put("conflict", at, state.status.consistency.residual_mps);
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

/** @typedef {{ channel: string, width: number, swatch: Element }} Line */
/** @typedef {(value: number) => number} Scale From a time or value to pixels. */
/**
 * @typedef {object} Row A chart and its legend.
 * @property {string} title
 * @property {string} unit
 * @property {number} decimals
 * @property {number} least
 * @property {[label: string, channel: string][]} series
 * @property {boolean} [positive]
 * @property {boolean} [pairs] Whether each channel has a commanded one.
 */

export class Chart {
  /**
   * `lines` are `{channel, width, swatch}`; the colour of the swatch is that of the line.
   * @param {Recorder} recorder
   * @param {HTMLCanvasElement} canvas
   * @param {{ lines: Line[], least: number, positive: boolean, axis: boolean }} options
   */
  constructor(recorder, canvas, { lines, least, positive, axis }) {
    this._recorder = recorder;
    this._canvas = canvas;
    this._lines = lines;
    this._least = least;
    this._positive = positive;
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
    const style = getComputedStyle(canvas);
    const top = this._range(nowS);
    const bottom = this._positive ? 0 : -top;
    /** @type {Scale} */
    const x = (timeS) => GUTTER_PX + ((timeS - nowS + SPAN_S) / SPAN_S) * (width - GUTTER_PX - 1);
    /** @type {Scale} */
    const y = (value) => 5 + ((top - value) / (top - bottom)) * (HEIGHT_PX - 10);
    this._grid(pen, style, { x, y, top, bottom, width, nowS });
    pen.save();
    pen.beginPath();
    pen.rect(GUTTER_PX, 0, width - GUTTER_PX, HEIGHT_PX);
    pen.clip();
    for (const line of this._lines) this._line(pen, line, x, y, nowS);
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

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {CSSStyleDeclaration} style
   * @param {{ x: Scale, y: Scale, top: number, bottom: number, width: number, nowS: number }} frame
   */
  _grid(pen, style, { x, y, top, bottom, width, nowS }) {
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

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {Line} line
   * @param {Scale} x
   * @param {Scale} y
   * @param {number} nowS
   */
  _line(pen, { channel, width, swatch }, x, y, nowS) {
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

/** @type {Row} */
const CONFLICT = {
  title: "Conflict",
  unit: "m/s",
  decimals: 3,
  least: 0.02,
  series: [["residual", "conflict"]],
  positive: true,
};
/** @type {Record<RobotInfo["panel"], (robot: RobotInfo) => Row[]>} */
const ACTUATORS = {
  gimbals: ({ modules }) => [
    {
      title: "Tilt",
      unit: "°",
      decimals: 1,
      least: 5,
      series: modules.map((name, i) => [String(i + 1), `tilt ${name}`]),
      positive: true,
    },
    CONFLICT,
  ],
  wheels: (card) => [speeds(card), CONFLICT],
  sphere: (card) => [
    speeds(card),
    {
      title: "Models apart",
      unit: "°",
      decimals: 1,
      least: 4,
      series: [["ideal to dual", "models"]],
      positive: true,
    },
  ],
};

/**
 * Numbers of the twist, those of one unit in one chart.
 * @param {RobotInfo} robot
 * @returns {Row[]}
 */
function motion({ space, numbers }) {
  /** @type {Record<string, number>} */
  const least = { "m/s": 0.2, "rad/s": 0.5 };
  const units = [...new Set(numbers.map(({ unit }) => unit))];
  /** @type {Record<string, string>} */
  const titles = { "m/s": "Velocity", "rad/s": space === "ball" ? "Turning" : "Turn rate" };
  return units.map((unit) => ({
    title: titles[unit],
    unit,
    decimals: 2,
    least: least[unit],
    series: numbers.filter((one) => one.unit === unit).map(({ symbol, name }) => [symbol, name]),
    pairs: true,
  }));
}

/**
 * @param {RobotInfo} robot
 * @returns {Row}
 */
function speeds({ wheels, max_rpm: most }) {
  return {
    title: "Wheels",
    unit: "rpm",
    decimals: 0,
    least: (most ?? NaN) / 10,
    series: wheels.map((name, i) => [String(i + 1), name]),
    pairs: true,
  };
}

export class Plots {
  /** @param {Recorder} recorder @param {ShadowRoot} place */
  constructor(recorder, place) {
    this._recorder = recorder;
    /** @type {{ chart: Chart, values: { node: Element, channel: string, decimals: number }[] }[]} */
    this._rows = [];
    this._place = el("div", { class: "plots" });
    place.append(this._place);
    this._timer = setInterval(() => this._draw(), FRAME_MS);
  }

  close() {
    clearInterval(this._timer);
  }

  _draw() {
    if (!isVisible(this._place)) return;
    if (this._recorder.card === null) return;
    if (this._recorder.card !== this._card) this._build(this._recorder.card);
    const nowS = performance.now() / 1000;
    for (const { chart, values } of this._rows) {
      chart.draw(nowS);
      for (const { node, channel, decimals } of values)
        setText(node, fixed(this._recorder.newest(channel), decimals));
    }
  }

  /** @param {RobotInfo} card */
  _build(card) {
    this._card = card;
    /** @type {Row[]} */
    const rows = [
      ...motion(card),
      ...ACTUATORS[card.panel](card),
      {
        title: "Round trip",
        unit: "ms",
        decimals: 0,
        least: 20,
        series: [["page to robot", "latency"]],
        positive: true,
      },
    ];
    const shown = rows.map((row, i) => this._row(row, i === rows.length - 1));
    this._rows = shown;
    this._place.replaceChildren(
      el(
        "p",
        { class: "key" },
        el("span", { class: "thin" }),
        "commanded",
        el("span", { class: "thick" }),
        "estimated",
      ),
      ...shown.map(({ element }) => element),
    );
  }

  /** @param {Row} row @param {boolean} last */
  _row({ title, unit, decimals, series, pairs, least, positive }, last) {
    const values = series.map(([label, channel], i) => ({
      label,
      channel,
      decimals,
      tone: TONES[i % TONES.length],
      node: el("span", { class: "value" }),
    }));
    const legend = values.map(({ label, tone, node }) =>
      el("span", { class: `series ${tone}` }, el("i"), label, " ", node),
    );
    const canvas = el("canvas", {
      role: "img",
      "aria-label": `${title} over the last 20 seconds, ${unit}`,
    });
    const chart = new Chart(this._recorder, canvas, {
      lines: values.flatMap(({ channel }, i) => [
        ...(pairs ? [{ channel: `set ${channel}`, width: 1, swatch: legend[i] }] : []),
        { channel, width: 2.25, swatch: legend[i] },
      ]),
      least,
      positive: positive ?? false,
      axis: last,
    });
    const head = el(
      "div",
      { class: "head" },
      el("strong", {}, title),
      el("span", { class: "unit" }, unit),
      el("span", { class: "legend" }, ...legend),
    );
    return { element: el("figure", { class: "chart" }, head, canvas), chart, values };
  }
}
