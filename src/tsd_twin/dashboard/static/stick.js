// The stick: up is forward, left is left.

import { el, mark } from "./dom.js";
import { fixed } from "./format.js";
import { Handle } from "./handle.js";

const KNOB_PX = 22; // Half of it: the knob stays inside.

export class Stick {
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
    this._handle = new Handle(this.pad, {
      reach: (box) => box.width / 2 - KNOB_PX,
      place: (right, up) => this._place(right, up),
      changed: () => drive.changed(),
    });
  }

  get held() {
    return this._handle.held;
  }

  cancel() {
    this._handle.cancel();
  }

  key(event) {
    return this._handle.key(event);
  }

  /** Draw what is asked for and what the robot makes of it, as shares of what the level allows. */
  draw(unit, allowed, level, scale, space) {
    put(this._asked, unit.x, unit.y);
    this.pad.style.setProperty("--level", level / 100);
    const [forward, left, word] = space.stick;
    const said = [unit.x, unit.y].map((share) => fixed(share * scale.speed, 2));
    mark(this.pad, "aria-valuetext", `${forward} ${said[0]}, ${left} ${said[1]} ${word}`);
    mark(this._allowed, "hidden", allowed === null ? "" : null);
    mark(this._gap, "hidden", allowed === null ? "" : null);
    if (allowed === null) return;
    const length = Math.max(1, Math.hypot(allowed.x, allowed.y));
    const [x, y] = [allowed.x / length, allowed.y / length];
    put(this._allowed, x, y);
    put(this._gap, x, y);
    this._gap.style.setProperty("--length", Math.hypot(unit.x - x, unit.y - y).toFixed(4));
    this._gap.style.setProperty(
      "--angle",
      `${Math.atan2(-(unit.x - x), -(unit.y - y)).toFixed(4)}rad`,
    );
  }

  _place(right, up) {
    const length = Math.max(1, Math.hypot(right, up));
    this.unit = { x: up / length, y: -right / length, turn: 0 };
  }
}

function put(node, x, y) {
  node.style.setProperty("--right", (-y).toFixed(4));
  node.style.setProperty("--up", x.toFixed(4));
}
