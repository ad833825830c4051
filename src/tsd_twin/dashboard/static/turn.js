// The turn slider: left turns left, counter-clockwise seen from above.

import { el, mark } from "./dom.js";
import { fixed } from "./format.js";
import { Handle } from "./handle.js";

const KNOB_PX = 28;

export class Turn {
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
    this._handle = new Handle(this.track, {
      reach: (box) => box.width / 2 - KNOB_PX,
      place: (right) => this._place(right),
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
  draw(turn, allowed, omega) {
    this._asked.style.setProperty("--right", (-turn).toFixed(4));
    mark(this._allowed, "hidden", allowed === null ? "" : null);
    if (allowed !== null) {
      this._allowed.style.setProperty("--right", Math.max(-1, Math.min(1, -allowed)).toFixed(4));
    }
    mark(this.track, "aria-valuenow", Math.round(100 * turn));
    const way = turn === 0 ? "" : turn > 0 ? " left" : " right";
    mark(this.track, "aria-valuetext", `${fixed(Math.abs(omega), 2)} rad/s${way}`);
  }

  _place(right) {
    this.unit = { x: 0, y: 0, turn: Math.max(-1, Math.min(1, -right)) };
  }
}
