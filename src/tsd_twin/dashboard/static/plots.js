// Plots: the last twenty seconds; what is commanded thin, what is estimated thick, same colour.

import { Chart } from "./chart.js";
import { el, say } from "./dom.js";
import { fixed } from "./format.js";
import { isSeen } from "./panels.js";

const FRAME_MS = 80;
const TONES = ["one", "two", "three", "four"];

export class Plots {
  constructor(recorder, place) {
    this._recorder = recorder;
    this._place = el("div", { class: "plots" });
    place.append(this._place);
    this._timer = setInterval(() => this._draw(), FRAME_MS);
  }

  close() {
    clearInterval(this._timer);
  }

  _draw() {
    if (!isSeen(this._place)) return;
    const key = `${this._recorder.robot} ${this._recorder.modules}`;
    if (key !== this._key) this._build(key);
    const nowS = performance.now() / 1000;
    for (const { chart, values } of this._rows) {
      chart.draw(nowS);
      for (const { node, channel, decimals } of values)
        say(node, fixed(this._recorder.newest(channel), decimals));
    }
  }

  _build(key) {
    this._key = key;
    const modules = this._recorder.modules;
    const rows = [
      {
        title: "Velocity",
        unit: "m/s",
        decimals: 2,
        least: 0.2,
        series: [
          ["vx", "vx"],
          ["vy", "vy"],
        ],
        pairs: true,
      },
      {
        title: "Turn rate",
        unit: "rad/s",
        decimals: 2,
        least: 0.5,
        series: [["ω", "omega"]],
        pairs: true,
      },
      {
        title: "Tilt",
        unit: "°",
        decimals: 1,
        least: 5,
        series: modules.map((name, i) => [String(i + 1), `tilt ${name}`]),
        positive: true,
      },
      {
        title: "Conflict",
        unit: "m/s",
        decimals: 3,
        least: 0.02,
        series: [["residual", "conflict"]],
        positive: true,
      },
      {
        title: "Round trip",
        unit: "ms",
        decimals: 0,
        least: 20,
        series: [["page to robot", "latency"]],
        positive: true,
      },
    ];
    this._rows = rows.map((row, i) => this._row(row, i === rows.length - 1));
    this._place.replaceChildren(
      el(
        "p",
        { class: "key" },
        el("span", { class: "thin" }),
        "commanded",
        el("span", { class: "thick" }),
        "estimated",
      ),
      ...this._rows.map(({ element }) => element),
    );
  }

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
