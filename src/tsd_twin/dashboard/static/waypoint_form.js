// Form with coordinates and heading of a goal.

import { el, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { notPlan } from "./permission.js";

/** @type {[string, string, string][]} */
const FIELDS = [
  ["x", "x (m)", "Forward of the origin"],
  ["y", "y (m)", "Left of the origin"],
  ["heading", "heading (°)", "Where to look on arrival; empty keeps it"],
];

const MOST = 10000; // What a message may have.

export class WaypointForm {
  /** @param {Link} link @param {Waypoints} going @param {ShadowRoot} place */
  constructor(link, going, place) {
    this._link = link;
    this._going = going;
    /** @type {Record<string, HTMLInputElement>} */
    this._fields = {};
    this._why = el("p", { class: "muted", role: "status", "aria-label": "Go to" });
    this._button = el("button", { class: "button" }, "Plan");
    this._form = el(
      "form",
      {
        class: "route-form",
        "aria-label": "Go to",
        novalidate: true,
        onsubmit: (event) => this._plan(event),
      },
      el("strong", {}, "Go to"),
      el("div", { class: "fields" }, ...FIELDS.map((field) => this._field(...field))),
      this._button,
      this._why,
    );
    place.append(this._form);
    this._open = true;
    link.on("state", () => this._open && this._show());
    link.on("robot", () => this._open && this._show());
    this._show();
  }

  close() {
    this._open = false;
  }

  /** @param {string} name @param {string} label @param {string} hint */
  _field(name, label, hint) {
    const input = el("input", {
      type: "number",
      step: "any",
      min: -MOST,
      max: MOST,
      inputmode: "decimal",
      title: hint,
    });
    this._fields[name] = input;
    return el("label", {}, label, input);
  }

  _show() {
    this._form.hidden = this._link.robot?.space !== "floor";
    const reason = notPlan(this._link);
    setAttribute(this._button, "aria-disabled", reason === null ? null : "true");
    const pose = this._link.state?.pose;
    for (const [i, name] of ["x", "y"].entries())
      setAttribute(this._fields[name], "placeholder", pose ? fixed(pose[i], 2) : "");
    const route = this._going.route;
    setText(
      this._why,
      reason ??
        (route?.phase === "planned"
          ? `${fixed(route.length_m, 2)} m: hold G, or Hold to go.`
          : "An empty place is where the robot is."),
    );
  }

  /** @param {Event} event */
  _plan(event) {
    event.preventDefault();
    const pose = this._link.state?.pose;
    if (!pose || !this._form.reportValidity()) return; // The browser says what is no such number.
    /** @type {<T>(name: string, missing: T) => number | T} */
    const number = (name, missing) => {
      const { value } = this._fields[name];
      return value === "" ? missing : Number(value);
    };
    const degrees = number("heading", null);
    this._going.plan({
      kind: "to",
      on: "floor",
      points: [[number("x", pose[0]), number("y", pose[1])]],
      heading: degrees === null ? null : (degrees * Math.PI) / 180,
    });
  }
}
