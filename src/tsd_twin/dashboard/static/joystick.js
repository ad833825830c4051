// Drive joystick (up is forward, left is left) and turn slider (left turns left, counter-clockwise).

import { el, setAttribute } from "./dom.js";
import { fixed } from "./format.js";
import { SpringControl } from "./held_controls.js";

// The stick: up is forward, left is left.
const STICK_KNOB_PX = 22; // Half of it: the knob stays inside.

export class Joystick {
  /** @param {Drive} drive */
  constructor(drive) {
    this.unit = { x: 0, y: 0, turn: 0 };
    this._asked = el("div", { class: "asked" });
    this._allowed = el("div", { class: "allowed", hidden: true });
    this._gap = el("div", { class: "gap", hidden: true });
    this.pad = el(
      "div",
      {
        class: "pad",
        role: "region",
        "aria-label": "Drive stick",
        "aria-describedby": "stick-help",
        tabindex: "0",
      },
      el("div", { class: "level" }),
      this._gap,
      this._allowed,
      this._asked,
    );
    this.element = el(
      "div",
      { class: "control stick" },
      el("div", { class: "caption", "aria-hidden": "true" }, "Drive"),
      this.pad,
      el(
        "span",
        { class: "sr", id: "stick-help" },
        "Drag, or use the arrow keys: up is forward. It springs back.",
      ),
    );
    this._springControl = new SpringControl(this.pad, {
      reach: (box) => box.width / 2 - STICK_KNOB_PX,
      place: (right, up) => this._place(right, up),
      changed: () => drive.changed(),
    });
  }

  get held() {
    return this._springControl.held;
  }

  cancel() {
    this._springControl.cancel();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    return this._springControl.key(event);
  }

  /**
   * Draw what is asked for and what the robot makes of it, as shares of what the level allows.
   * @param {Unit} unit
   * @param {Unit | null} allowed
   * @param {number} level
   * @param {{ speed: number, turn: number }} scale
   * @param {TwistMapping} space
   */
  draw(unit, allowed, level, scale, space) {
    placeKnob(this._asked, unit.x, unit.y);
    this.pad.style.setProperty("--level", String(level / 100));
    const [forward, left, word] = space.stick;
    const said = [unit.x, unit.y].map((share) => fixed(share * scale.speed, 2));
    setAttribute(this.pad, "aria-valuetext", `${forward} ${said[0]}, ${left} ${said[1]} ${word}`);
    setAttribute(this._allowed, "hidden", allowed === null ? "" : null);
    setAttribute(this._gap, "hidden", allowed === null ? "" : null);
    if (allowed === null) return;
    const length = Math.max(1, Math.hypot(allowed.x, allowed.y));
    const [x, y] = [allowed.x / length, allowed.y / length];
    placeKnob(this._allowed, x, y);
    placeKnob(this._gap, x, y);
    this._gap.style.setProperty("--length", Math.hypot(unit.x - x, unit.y - y).toFixed(4));
    this._gap.style.setProperty(
      "--angle",
      `${Math.atan2(-(unit.x - x), -(unit.y - y)).toFixed(4)}rad`,
    );
  }

  /** @param {number} right @param {number} up */
  _place(right, up) {
    const length = Math.max(1, Math.hypot(right, up));
    this.unit = { x: up / length, y: -right / length, turn: 0 };
  }
}

/** @param {HTMLElement} node @param {number} x @param {number} y */
function placeKnob(node, x, y) {
  node.style.setProperty("--right", (-y).toFixed(4));
  node.style.setProperty("--up", x.toFixed(4));
}

// The turn slider: left turns left, counter-clockwise seen from above.
const TURN_KNOB_PX = 28;

export class TurnSlider {
  /** @param {Drive} drive */
  constructor(drive) {
    this.unit = { x: 0, y: 0, turn: 0 };
    this._asked = el("div", { class: "asked" });
    this._allowed = el("div", { class: "allowed", hidden: true });
    this.track = el(
      "div",
      {
        class: "track",
        role: "slider",
        "aria-label": "Turn",
        "aria-valuemin": "-100",
        "aria-valuemax": "100",
        "aria-valuenow": "0",
        tabindex: "0",
      },
      el("div", { class: "centre" }),
      this._allowed,
      this._asked,
    );
    this.element = el(
      "div",
      { class: "control turn" },
      el("div", { class: "caption", "aria-hidden": "true" }, "Turn"),
      this.track,
    );
    this._springControl = new SpringControl(this.track, {
      reach: (box) => box.width / 2 - TURN_KNOB_PX,
      place: (right) => this._place(right),
      changed: () => drive.changed(),
    });
  }

  get held() {
    return this._springControl.held;
  }

  cancel() {
    this._springControl.cancel();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    return this._springControl.key(event);
  }

  /**
   * Draw what is asked for and what the robot makes of it, as shares of what the level allows.
   * @param {number} turn
   * @param {number | null} allowed
   * @param {number} omega
   */
  draw(turn, allowed, omega) {
    this._asked.style.setProperty("--right", (-turn).toFixed(4));
    setAttribute(this._allowed, "hidden", allowed === null ? "" : null);
    if (allowed !== null) {
      this._allowed.style.setProperty("--right", Math.max(-1, Math.min(1, -allowed)).toFixed(4));
    }
    setAttribute(this.track, "aria-valuenow", Math.round(100 * turn));
    const way = turn === 0 ? "" : turn > 0 ? " left" : " right";
    setAttribute(this.track, "aria-valuetext", `${fixed(Math.abs(omega), 2)} rad/s${way}`);
  }

  /** @param {number} right */
  _place(right) {
    this.unit = { x: 0, y: 0, turn: Math.max(-1, Math.min(1, -right)) };
  }
}
