// A dial for each gimbal, seen from above, forward up: where the axle should lean and where it does.

import { ConsistencyMeter } from "./consistency.js";
import { el, isVisible, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";
import { known } from "./link.js";

const REACH = 40; // Radius of the tilt limit in the drawing.

export class Gimbals {
  /** @param {Link} link @param {HTMLElement} place */
  constructor(link, place) {
    this._link = link;
    this._list = el("div", { class: "gimbals" });
    this._conflict = new ConsistencyMeter("Module");
    this._waiting = el("p", { class: "muted" }, "Waiting for the robot.");
    this._all = el(
      "div",
      {},
      el(
        "p",
        { class: "key" },
        el("i", { class: "ring" }),
        "set-point",
        el("i", { class: "dot" }),
        "measured",
        el("span", { class: "muted" }, "from above, forward up"),
      ),
      this._list,
      ...this._conflict.elements,
    );
    place.append(this._waiting, this._all);
    /** @type {Dial[]} */
    this._dials = [];
    this._open = true;
    link.on("state", () => this._open && isVisible(place) && this._show());
    link.on("robot", () => this._open && this._build());
    this._build();
  }

  close() {
    this._open = false;
  }

  _build() {
    const robot = this._link.robot;
    this._waiting.hidden = robot !== null;
    this._all.hidden = robot === null;
    if (robot === null) return;
    this._dials = robot.modules.map((name, i) => new Dial(i + 1, robot));
    this._list.replaceChildren(...this._dials.map((dial) => dial.element));
  }

  _show() {
    const { modules, status } = known(this._link.state);
    const names = known(this._link.robot).modules;
    modules.forEach((module, i) =>
      this._dials[i]?.show(module, names[i] === status.consistency.suspect),
    );
    this._conflict.show(status.consistency, names, "The modules agree.");
  }
}

class Dial {
  /** @param {number} number @param {RobotInfo} robot */
  constructor(number, robot) {
    /** @type {Record<string, Element>} */
    this._cells = {};
    this._set = svg("circle", { class: "ring", r: 5 });
    this._dot = svg("circle", { class: "dot", r: 4 });
    this._lean = svg("line", { class: "lean", x1: 0, y1: 0 });
    this._spin = svg(
      "g",
      { class: "spin" },
      svg("path", { d: "M0 -46A46 46 0 0 0 -23 -39.8" }),
      svg("path", { d: "M0 46A46 46 0 0 0 23 39.8" }),
    );
    const limit = fixed(robot.max_tilt_deg, 0);
    const face = svg(
      "svg",
      {
        class: "dial",
        viewBox: "-50 -50 100 100",
        role: "img",
        "aria-label": `Axle of module ${number}; the circle is ${limit} degrees`,
      },
      svg("circle", { class: "limit", r: REACH }),
      svg("circle", { class: "half", r: REACH / 2 }),
      svg("path", { class: "cross", d: `M0 ${-REACH}V${REACH}M${-REACH} 0H${REACH}` }),
      svg("text", { class: "limit-text", x: 3, y: -REACH + 10 }, `${limit}°`),
      this._spin,
      this._lean,
      this._set,
      this._dot,
    );
    this.element = el(
      "section",
      { class: "module", "aria-label": `Module ${number}` },
      face,
      el(
        "dl",
        {},
        el(
          "div",
          { class: "title" },
          el("dt", {}, `Module ${number}`),
          el("dd", {}, (this._state = el("span", { class: "muted" }))),
        ),
        ...[
          ["tilt", "°"],
          ["α", "°"],
          ["β", "°"],
          ["radius", "mm"],
          ["speed", "rpm"],
        ].map(([name, unit]) => this._row(name, unit)),
      ),
    );
  }

  /** @param {GimbalState} module @param {boolean} suspect */
  show(module, suspect) {
    const cells = this._cells;
    setText(cells.tilt, fixed(module.tilt, 1));
    setText(cells.α, fixed(module.alpha, 1));
    setText(cells.β, fixed(module.beta, 1));
    setText(cells.radius, fixed(module.radius_mm, 2));
    setText(cells.speed, fixed(module.rpm, 0));
    setText(this._state, suspect ? "suspect" : module.spinning ? "spinning" : "at rest");
    setAttribute(this.element, "data-spinning", module.spinning ? "" : null);
    setAttribute(this.element, "data-suspect", suspect ? "" : null);
    put(this._set, module.set_axle);
    put(this._dot, module.axle);
    const [x, y] = place(module.axle);
    setAttribute(this._lean, "x2", x);
    setAttribute(this._lean, "y2", y);
  }

  /** @param {string} name @param {string} unit */
  _row(name, unit) {
    const value = el("span", { class: "value" });
    this._cells[name] = value;
    return el(
      "div",
      {},
      el("dt", {}, name),
      el("dd", {}, value, el("span", { class: "unit" }, unit)),
    );
  }
}

/** @param {Element} node @param {[number, number]} axle */
function put(node, axle) {
  const [x, y] = place(axle);
  setAttribute(node, "cx", x);
  setAttribute(node, "cy", y);
}

/**
 * From the robot's axes, x forward and y left, to the drawing's, x right and y down.
 * @param {[number, number]} axle
 */
function place([x, y]) {
  return [(-y * REACH).toFixed(2), (-x * REACH).toFixed(2)];
}
