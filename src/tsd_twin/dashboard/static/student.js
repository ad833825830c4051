// Student tab: adjustable geometry and speed with their effects. Requires no robot.

import { el, isVisible, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";
import { ModuleDrawing } from "./module_drawing.js";
import { ReachPlot } from "./reach_plot.js";
import { linkTo } from "./student_model.js";

const REACH = 42; // Wheel extent in the robot drawing, relative to half its width.
const TOML_TYPE = "application/toml";
const KEPT_MS = 10_000; // The browser may read the file some time after the click.
const TWIST_STEPS = 40; // Minimum number of steps from zero to the end.

export class Student {
  /** @param {Link} link @param {ShadowRoot} place @param {AbortSignal} signal @param {StudentModel} model */
  constructor(link, place, signal, model) {
    this._desk = model;
    this._wantsFile = false;
    this._robots = el("select", {
      "aria-label": "Robot to start from",
      onchange: () => this._choose(),
    });
    this._knobs = new Fields("Knobs", (key, value) => model.turn(key, value));
    this._twist = new Fields("Twist", (key, value) => model.move(Number(key), value));
    this._problem = el("p.problem", { role: "alert" });
    this._figures = el("dl.results", { "aria-label": "What follows" });
    this._scaled = el("p.muted");
    this._plots = [new ReachPlot(), new ReachPlot(), new ReachPlot()];
    this._sketch = new Sketch();
    this._wheels = el("table");
    this._module = new ModuleDrawing();
    this._address = el("input.address", {
      type: "text",
      readonly: true,
      "aria-label": "Link to this setting",
      onfocus: () => this._selectAddress(),
    });
    this._said = el("span.muted", { role: "status" });
    const button = (/** @type {string} */ label, /** @type {() => void} */ onclick) =>
      el("button", { type: "button", onclick }, label);
    const save = button("Save as TOML", () => ((this._wantsFile = true), model.requestToml()));
    this._results = el(
      "div.figures-part",
      this._sketch.element,
      this._figures,
      el("h3", "Reachable twists"),
      el("p.muted", "Filled: the third part of the twist is zero. Line: it may be anything."),
      el("div.plots", ...this._plots.map((plot) => plot.element)),
      el("h3", "Joints for a twist"),
      ...[this._twist.element, this._scaled, this._wheels, this._module.element],
    );
    place.append(
      el(
        "section.student",
        { "aria-label": "Student" },
        el("p.muted", "Turn the knobs of a robot that is not there. No robot moves."),
        el(
          "div.head",
          this._robots,
          button("Reset knobs", () => model.reset()),
        ),
        ...[this._knobs.element, this._problem, this._results],
        el(
          "div.head",
          save,
          button("Copy link", () => void this._copy()),
        ),
        ...[this._address, this._said],
      ),
    );
    model.on((reply) => this._show(reply), signal);
    link.on("beat", () => isVisible(place.host) && model.refresh(), signal);
    if (model.reply !== null) this._show(model.reply);
  }

  _choose() {
    this._desk.choose(this._robots.value);
  }

  _selectAddress() {
    this._address.select();
  }

  /** @param {StudentReply} reply */
  _show(reply) {
    const { setting } = this._desk;
    this._showRobots(reply);
    this._knobs.show(
      reply.knobs.map((knob) => ({ ...knob, value: setting.knobs[knob.key] ?? knob.value })),
    );
    setText(this._problem, reply.problem === "" ? "" : `Impossible: ${reply.problem}`);
    this._results.toggleAttribute("data-old", reply.figures === null);
    if (reply.figures !== null) this._showFigures(reply.figures);
    const address = linkTo(setting, location.href);
    if (this._address.value !== address) this._address.value = address;
    if (reply.toml !== null && this._wantsFile) this._save(reply.base, reply.toml);
  }

  /** @param {StudentReply} reply */
  _showRobots({ bases }) {
    if (this._robots.length !== bases.length)
      this._robots.replaceChildren(
        ...bases.map(({ id, title }) => el("option", { value: id }, title)),
      );
    this._robots.value = this._desk.setting.base;
  }

  /** @param {StudentFigures} figures */
  _showFigures(figures) {
    const { axes, tops, outlines, wheels, radius_m: radius } = figures;
    const row = (/** @type {StudentFigure} */ { name, value, unit, note }) =>
      el(
        "div",
        el("dt", name, el("span.note", note)),
        el("dd", el("span.value", fixed(value, decimals(value))), el("span.unit", unit)),
      );
    this._figures.replaceChildren(...figures.figures.map(row));
    outlines.forEach((outline, i) => this._plots[i].show(outline, figures));
    const { twist } = this._desk.setting;
    this._twist.show(
      axes.map(({ symbol, unit }, i) => {
        const step = 10 ** Math.floor(Math.log10(tops[i] / TWIST_STEPS));
        const most = Number((Math.ceil(tops[i] / step) * step).toPrecision(6));
        const value = twist[i];
        return { key: String(i), label: symbol, unit, value, usual: 0, least: -most, most, step };
      }),
    );
    setText(this._scaled, sayShare(figures));
    this._sketch.show(wheels, radius);
    this._wheels.replaceChildren(...tableOf(wheels));
    this._showModule(wheels);
  }

  /** @param {StudentWheel[]} wheels */
  _showModule(wheels) {
    const { gimbal, axle, rpm, effective_radius_mm: radius } = wheels[0];
    this._module.element.hidden = gimbal === null;
    if (gimbal === null || axle === null || radius === null) return;
    // The drawing has no limit for comparison: a lean of half the wheel radius is full.
    const lean = /** @type {[number, number]} */ (axle.map((part) => 2 * part));
    this._module.show({ tilt_deg: gimbal[2], lean, rpm, radius_mm: radius }, "Module 1");
  }

  /** @param {string} base @param {string} toml */
  _save(base, toml) {
    this._wantsFile = false;
    const url = URL.createObjectURL(new Blob([toml], { type: TOML_TYPE }));
    const file = `my-${base}.toml`;
    el("a", { href: url, download: file }).click();
    setTimeout(() => URL.revokeObjectURL(url), KEPT_MS);
    setText(this._said, `Saved. Run it with tsd-demo --robot ${file}`);
  }

  async _copy() {
    try {
      await navigator.clipboard.writeText(this._address.value);
      setText(this._said, "The link is copied.");
    } catch {
      this._address.select(); // Without permission, or over plain HTTP.
      setText(this._said, "Copy the selected link.");
    }
  }
}

/** Sliders with number fields, one per parameter; per-wheel parameters are folded together. */
class Fields {
  /** @param {string} name @param {(key: string, value: number) => void} turn */
  constructor(name, turn) {
    this._turn = turn;
    this._keys = "";
    /** @type {Map<string, HTMLInputElement[]>} */
    this._inputs = new Map();
    this.element = el("div.knobs", { role: "group", "aria-label": name });
  }

  /** @param {StudentKnob[]} knobs */
  show(knobs) {
    const keys = knobs.map(({ key, label, unit }) => `${key} ${label} ${unit}`).join();
    if (keys !== this._keys) this._build(knobs);
    this._keys = keys;
    const root = /** @type {ShadowRoot | Document} */ (this.element.getRootNode());
    for (const { key, value, unit, least, most, step } of knobs) {
      for (const input of this._inputs.get(key) ?? []) {
        for (const [name, limit] of Object.entries({ min: least, max: most, step }))
          setAttribute(input, name, limit);
        const text = fixedText(value);
        if (input.type === "range") setAttribute(input, "aria-valuetext", `${text} ${unit}`);
        // Do not overwrite a field being edited.
        if (input !== root.activeElement && input.value !== text) input.value = text;
      }
    }
  }

  /** @param {StudentKnob[]} knobs */
  _build(knobs) {
    this._inputs.clear();
    /** @type {Map<string, HTMLElement>} */
    const folds = new Map();
    this.element.replaceChildren();
    for (const knob of knobs) {
      const wheel = /\.(\d+)\.\w+$/.exec(knob.key)?.[1];
      const fold = wheel === undefined ? this.element : (folds.get(wheel) ?? el("details"));
      if (wheel !== undefined && !folds.has(wheel)) {
        fold.append(el("summary", `Wheel ${Number(wheel) + 1}`));
        folds.set(wheel, fold);
        this.element.append(fold);
      }
      fold.append(this._row(knob));
    }
  }

  /** @param {StudentKnob} knob */
  _row({ key, label, unit }) {
    const input = (/** @type {string} */ type) => {
      const oninput = () => {
        const value = Number(node.value);
        if (node.value === "" || !Number.isFinite(value)) return;
        for (const other of this._inputs.get(key) ?? [])
          if (other !== node) other.value = node.value;
        this._turn(key, value);
      };
      const name = type === "range" ? label : `${label}${unit === "" ? "" : `, ${unit}`}`;
      const node = el("input", { type, "aria-label": name, oninput });
      return node;
    };
    const both = [input("range"), input("number")];
    this._inputs.set(key, both);
    const name = el("span", { "aria-hidden": "true" }, label);
    return el("div.knob", el("div.head", name, both[1], el("span.unit", unit)), both[0]);
  }
}

/** Robot from above, forward up: wheels and their velocities. */
class Sketch {
  constructor() {
    this.element = svg("svg.sketch", {
      viewBox: "-56 -56 112 112",
      role: "img",
      "aria-label": "The robot from above, forward up",
    });
  }

  /** @param {StudentWheel[]} wheels @param {number} radius */
  show(wheels, radius) {
    const far = Math.max(...wheels.map(({ at: [x, y] }) => Math.hypot(x, y))) + radius;
    const fast = Math.max(1e-9, ...wheels.map(({ push: [x, y] }) => Math.hypot(x, y)));
    const place = (/** @type {[number, number]} */ [x, y], /** @type {number} */ scale) =>
      [-y * scale, -x * scale].map((part) => part.toFixed(2)).join(" ");
    const scale = REACH / far;
    const wide = Math.max(2, radius * scale);
    const body = `M${wheels.map(({ at }) => place(at, scale)).join("L")}Z`;
    this.element.replaceChildren(
      svg("path.body", { d: body }),
      svg("path.front", { d: "M0 -12L5 -4H-5Z" }),
      ...wheels.map(({ at, push, direction_deg: direction, axle }, i) =>
        svg(
          "g",
          { transform: `translate(${place(at, scale)})` },
          direction === null
            ? svg("circle.wheel", { r: wide })
            : svg("rect.wheel", {
                ...{ x: -wide / 4, y: -wide, width: wide / 2, height: 2 * wide },
                transform: `rotate(${-direction})`,
              }),
          axle === null ? null : svg("path.axle", { d: `M0 0L${place(axle, 2 * wide)}` }),
          svg("path.push", { d: `M0 0L${place(push, 18 / fast)}` }),
          svg("text", { x: 0, y: wide + 8, "text-anchor": "middle" }, String(i + 1)),
        ),
      ),
    );
  }
}

/**
 * Describe the joint utilization of a twist, and the largest twist in its direction.
 * @param {StudentFigures} figures
 */
function sayShare({ axes, twist, utilization: share }) {
  if (share === 0) return "At rest.";
  const cut = share > 1 ? "; scaled as a whole to 100 %" : "";
  const most = axes.map(({ symbol, unit }, i) => {
    const part = (twist[i] * Math.max(1, share)) / share;
    return `${symbol} ${fixed(part, 2)} ${unit}`;
  });
  const percent = fixed(100 * share, 0);
  return `This twist takes ${percent} % of what the joints can do${cut}. The largest along it: ${most.join(", ")}.`;
}

/** @param {StudentWheel[]} wheels */
function tableOf(wheels) {
  const isGimbal = wheels[0].gimbal !== null;
  const names = isGimbal ? ["α °", "β °", "tilt °", "radius mm"] : ["speed rpm"];
  const cells = (/** @type {StudentWheel} */ { gimbal, effective_radius_mm: radius, rpm }) =>
    gimbal === null
      ? [fixed(rpm, 1)]
      : [...gimbal.map((angle) => fixed(angle, 2)), fixed(radius, 2)];
  const head = el("tr", ...["", ...names].map((name) => el("th", { scope: "col" }, name)));
  const rows = wheels.map((wheel, i) =>
    el(
      "tr",
      el("th", { scope: "row" }, String(i + 1)),
      ...cells(wheel).map((text) => el("td.value", text)),
    ),
  );
  return [el("caption", isGimbal ? "Gimbals" : "Wheels"), head, ...rows];
}

/** Return the number of decimals for three or four digits. @param {number} value */
export function decimals(value) {
  const size = Math.abs(value);
  return size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
}

/** Format a number for a field, without rounding artefacts. @param {number} value */
export function fixedText(value) {
  return String(Number(value.toPrecision(6)));
}
