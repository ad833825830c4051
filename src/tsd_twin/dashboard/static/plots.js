// Plots: the last twenty seconds; what is commanded thin, what is estimated thick, same colour.

import { Chart } from "./chart.js";
import { el, say } from "./dom.js";
import { fixed } from "./format.js";
import { isSeen } from "./seen.js";

const FRAME_MS = 80;
const TONES = ["one", "two", "three", "four"];

const CONFLICT = {
  title: "Conflict",
  unit: "m/s",
  decimals: 3,
  least: 0.02,
  series: [["residual", "conflict"]],
  positive: true,
};
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

/** Numbers of the twist, those of one unit in one chart. */
function motion({ space, numbers }) {
  const least = { "m/s": 0.2, "rad/s": 0.5 };
  const units = [...new Set(numbers.map(({ unit }) => unit))];
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

function speeds({ wheels, max_rpm: most }) {
  return {
    title: "Wheels",
    unit: "rpm",
    decimals: 0,
    least: most / 10,
    series: wheels.map((name, i) => [String(i + 1), name]),
    pairs: true,
  };
}

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
    if (this._recorder.card === null) return;
    if (this._recorder.card !== this._card) this._build(this._recorder.card);
    const nowS = performance.now() / 1000;
    for (const { chart, values } of this._rows) {
      chart.draw(nowS);
      for (const { node, channel, decimals } of values)
        say(node, fixed(this._recorder.newest(channel), decimals));
    }
  }

  _build(card) {
    this._card = card;
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
