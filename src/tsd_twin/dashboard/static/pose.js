// Where the robot believes it is, and how fast it goes.

import { el, say } from "./dom.js";
import { degrees, fixed } from "./format.js";

export class Pose {
  constructor(link) {
    this._link = link;
    this._cells = {};
    this.element = el(
      "div",
      { class: "pose surface" },
      el(
        "span",
        { class: "figures", role: "status", "aria-live": "off", "aria-label": "Pose" },
        this._figure("x", "m"),
        this._figure("y", "m"),
        this._figure("heading", "°"),
      ),
      el(
        "span",
        { class: "figures", role: "status", "aria-live": "off", "aria-label": "Speed" },
        this._figure("v", "m/s"),
        this._figure("ω", "rad/s"),
      ),
    );
    link.on("beat", () => this._draw()); // Half as often as there are states: nobody reads faster.
    link.on("robot", () => this._draw());
    this._draw();
  }

  _figure(name, unit) {
    const value = el("span", { class: "value number" });
    this._cells[name] = value;
    return el(
      "span",
      { class: "figure" },
      el("span", { class: "name" }, name),
      " ",
      value,
      el("span", { class: "unit" }, unit === "°" ? unit : ` ${unit}`),
      " ",
    );
  }

  _draw() {
    const { pose, twist } = this._link.state ?? {};
    const [x, y, heading] = pose ?? [];
    const [vx, vy, omega] = twist ?? [];
    say(this._cells.x, fixed(x, 2));
    say(this._cells.y, fixed(y, 2));
    say(this._cells.heading, degrees(heading));
    say(this._cells.v, fixed(twist ? Math.hypot(vx, vy) : undefined, 2));
    say(this._cells.ω, fixed(omega, 2));
  }
}
