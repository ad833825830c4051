// Form for the coordinates and heading of a goal.

import { el, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { kindOf } from "./kinds.js";
import { planBlockedReason } from "./blocked_reasons.js";

/** @type {[string, string, string][]} */
const FIELDS = [
  ["x", "x (m)", "Forward of the origin"],
  ["y", "y (m)", "Left of the origin"],
  ["heading", "heading (°)", "Heading on arrival"],
];

const MOST = 10000; // Limit of a message.

export class WaypointForm {
  /**
   * @param {Link} link @param {ShadowRoot} place @param {AbortSignal} signal
   * @param {Waypoints} waypoints
   */
  constructor(link, place, signal, waypoints) {
    this._link = link;
    this._waypoints = waypoints;
    /** @type {Record<string, HTMLInputElement>} */
    this._fields = {};
    this._why = el("p.muted", { role: "status", "aria-label": "Go to" });
    this._button = el("button.button", "Plan");
    this._form = el(
      "form.route-form",
      { "aria-label": "Go to", novalidate: true, onsubmit: (event) => this._plan(event) },
      el("strong", "Go to"),
      el("div.fields", ...FIELDS.map((field) => this._field(...field))),
      this._button,
      this._why,
    );
    place.append(this._form);
    link.on(["state", "robot", "beat", "down"], () => this._show(), signal);
    this._show();
  }

  /** @param {string} name @param {string} label @param {string} hint */
  _field(name, label, hint) {
    const range = { step: "any", min: -MOST, max: MOST };
    const input = el("input", { type: "number", inputmode: "decimal", title: hint, ...range });
    this._fields[name] = input;
    return el("label", label, input);
  }

  _show() {
    this._form.hidden = this._link.robot === null || !kindOf(this._link.robot).onFloor;
    const reason = planBlockedReason(this._link);
    setAttribute(this._button, "aria-disabled", reason === null ? null : "true");
    const pose = this._link.state?.pose;
    for (const [i, name] of ["x", "y"].entries())
      setAttribute(this._fields[name], "placeholder", pose ? fixed(pose[i], 2) : "");
    const route = this._waypoints.route;
    const next =
      route?.phase === "planned"
        ? `${fixed(route.length_m, 2)} m. Hold G to go.`
        : "Leave empty to keep the robot's value.";
    setText(this._why, reason ?? next);
  }

  /** @param {Event} event */
  _plan(event) {
    event.preventDefault();
    const pose = this._link.state?.pose;
    if (!pose || !this._form.reportValidity()) return; // The browser reports invalid numbers.
    const { x, y, heading } = this._fields;
    const numberOf = (/** @type {HTMLInputElement} */ { value }) =>
      value === "" ? null : Number(value);
    const degrees = numberOf(heading);
    this._waypoints.plan({
      kind: "to",
      on: "floor",
      points: [[numberOf(x) ?? pose[0], numberOf(y) ?? pose[1]]],
      heading: degrees === null ? null : (degrees * Math.PI) / 180,
    });
  }
}
