// One plot on a canvas: lines over the last twenty seconds, now at the right edge.

import { SPAN_S } from "./recorder.js";

const GUTTER_PX = 34;
const HEIGHT_PX = 72;
const AXIS_PX = 16;
const GAP_S = 0.3; // A line is not drawn over what was not seen.
const STEPS = [1, 2, 5, 10];

export class Chart {
  /** `lines` are `{channel, width, swatch}`; the colour of the swatch is that of the line. */
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

  draw(nowS) {
    const canvas = this._canvas;
    const [width, height, density] = [canvas.clientWidth, this._height, devicePixelRatio || 1];
    if (width < 2 * GUTTER_PX) return;
    if (canvas.width !== Math.round(width * density)) {
      canvas.width = Math.round(width * density);
      canvas.height = Math.round(height * density);
    }
    // In plain memory: a graphics card that is busy with the scene would keep this page waiting.
    const pen = canvas.getContext("2d", { willReadFrequently: true });
    pen.setTransform(density, 0, 0, density, 0, 0);
    pen.clearRect(0, 0, width, height);
    const style = getComputedStyle(canvas);
    const top = this._range(nowS);
    const bottom = this._positive ? 0 : -top;
    const x = (timeS) => GUTTER_PX + ((timeS - nowS + SPAN_S) / SPAN_S) * (width - GUTTER_PX - 1);
    const y = (value) => 5 + ((top - value) / (top - bottom)) * (HEIGHT_PX - 10);
    this._grid(pen, style, { x, y, top, bottom, width, nowS });
    pen.save();
    pen.beginPath();
    pen.rect(GUTTER_PX, 0, width - GUTTER_PX, HEIGHT_PX);
    pen.clip();
    for (const line of this._lines) this._line(pen, line, x, y, nowS);
    pen.restore();
  }

  /** Return the end of the value axis: a round number, that shrinks only when there is much room. */
  _range(nowS) {
    let most = this._least;
    for (const { channel } of this._lines) {
      this._recorder.each(channel, nowS - SPAN_S, (_, value) => {
        if (Math.abs(value) > most) most = Math.abs(value);
      });
    }
    const power = 10 ** Math.floor(Math.log10(most));
    const round = power * STEPS.find((step) => power * step >= most * 0.999);
    if (this._top === undefined || round > this._top || most < 0.4 * this._top) this._top = round;
    return this._top;
  }

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

function tick(value) {
  const text = Number(Math.abs(value).toPrecision(3)).toString();
  return value < 0 ? `\u2212${text}` : text;
}
