// One dial per gimbal, seen from above with forward up: setpoint and measured lean of the axle.

import { ConsistencyMeter } from "./consistency.js";
import { el, isVisible, legend, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";
import { assertDefined } from "./link.js";
import { enlargeModule } from "./module_inset.js";

const REACH = 40; // Radius of the tilt limit in the drawing.

export class Gimbals {
  /** @param {Link} link @param {HTMLElement} place @param {AbortSignal} signal */
  constructor(link, place, signal) {
    this._link = link;
    this._list = el("div.gimbals");
    this._meter = new ConsistencyMeter("Module");
    this._waiting = el("p.muted", "Waiting for the robot.");
    const key = legend("ring", "from above, forward up");
    this._all = el("div", key, this._list, ...this._meter.elements);
    place.append(this._waiting, this._all);
    /** @type {Dial[]} */
    this._dials = [];
    link.on("state", () => isVisible(place) && this._show(), signal);
    link.on("robot", () => this._build(), signal);
    this._build();
  }

  _build() {
    const robot = this._link.robot;
    this._waiting.hidden = robot !== null;
    this._all.hidden = robot === null;
    if (robot === null) return;
    this._dials = robot.modules.map((_, i) => new Dial(i + 1, assertDefined(robot.max_tilt_deg)));
    this._list.replaceChildren(...this._dials.map((dial) => dial.element));
  }

  _show() {
    const { modules, status } = assertDefined(this._link.state);
    const names = assertDefined(this._link.robot).modules;
    modules.forEach((module, i) =>
      this._dials[i]?.show(module, names[i] === status.consistency.suspect),
    );
    this._meter.show(status.consistency, names, "The modules agree.");
  }
}

class Dial {
  /** @param {number} number @param {number} maxTiltDeg */
  constructor(number, maxTiltDeg) {
    this._set = svg("circle.ring", { r: 5 });
    this._dot = svg("circle.dot", { r: 4 });
    this._lean = svg("line.lean", { x1: 0, y1: 0 });
    const limit = fixed(maxTiltDeg, 0);
    const name = `Axle of module ${number}; the circle is ${limit} degrees`;
    const face = svg(
      "svg.dial",
      { viewBox: "-50 -50 100 100", role: "img", "aria-label": name },
      svg("circle.limit", { r: REACH }),
      svg("circle.half", { r: REACH / 2 }),
      svg("path.cross", { d: `M0 ${-REACH}V${REACH}M${-REACH} 0H${REACH}` }),
      svg("text.limit-text", { x: 3, y: -REACH + 10 }, `${limit}°`),
      svg(
        "g.spin",
        svg("path", { d: "M0 -46A46 46 0 0 0 -23 -39.8" }),
        svg("path", { d: "M0 46A46 46 0 0 0 23 39.8" }),
      ),
      ...[this._lean, this._set, this._dot],
    );
    const enlarge = () => enlargeModule(number - 1);
    face.addEventListener("click", enlarge);
    const label = { "aria-label": `Enlarge module ${number}` };
    const button = el("button.enlarge", { type: "button", ...label, onclick: enlarge }, "Enlarge");
    this._state = el("span.muted");
    this._tilt = el("span.value");
    this._alpha = el("span.value");
    this._beta = el("span.value");
    this._radius = el("span.value");
    this._speed = el("span.value");
    this.element = el(
      "section.module",
      { "aria-label": `Module ${number}` },
      el("div.title", el("strong", `Module ${number}`), this._state, button),
      face,
      el(
        "dl",
        row("tilt", this._tilt, "°"),
        row("α", this._alpha, "°"),
        row("β", this._beta, "°"),
        row("radius", this._radius, "mm"),
        row("speed", this._speed, "rpm"),
      ),
    );
  }

  /** @param {GimbalState} module @param {boolean} suspect */
  show(module, suspect) {
    setText(this._tilt, fixed(module.tilt, 1));
    setText(this._alpha, fixed(module.alpha, 1));
    setText(this._beta, fixed(module.beta, 1));
    setText(this._radius, fixed(module.radius_mm, 2));
    setText(this._speed, fixed(module.rpm, 0));
    setText(this._state, suspect ? "suspect" : module.spinning ? "spinning" : "at rest");
    this.element.toggleAttribute("data-spinning", module.spinning);
    this.element.toggleAttribute("data-suspect", suspect);
    put(this._set, "cx", "cy", module.set_axle);
    put(this._dot, "cx", "cy", module.axle);
    put(this._lean, "x2", "y2", module.axle);
  }
}

/** @param {string} name @param {Element} value @param {string} unit */
function row(name, value, unit) {
  return el("div", el("dt", name), el("dd", value, el("span.unit", unit)));
}

/**
 * Place a point from robot axes (x forward, y left) in the drawing (x right, y down).
 * @param {Element} node @param {string} right @param {string} down @param {[number, number]} axle
 */
function put(node, right, down, [x, y]) {
  setAttribute(node, right, (-y * REACH).toFixed(2));
  setAttribute(node, down, (-x * REACH).toFixed(2));
}
