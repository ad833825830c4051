// Panel of a robot whose kind has none in the page: a row for each value that its package sends.

import { el, isVisible, setText } from "./dom.js";
import { fixed } from "./format.js";
import { assertDefined } from "./link.js";

export class Joints {
  /** @param {Link} link @param {HTMLElement} place @param {AbortSignal} signal */
  constructor(link, place, signal) {
    this._link = link;
    this._built = null;
    /** @type {{ set: HTMLElement, now: HTMLElement }[]} */
    this._rows = [];
    this._table = el("table.twist");
    place.append(this._table);
    link.on("state", () => isVisible(place) && this._show(), signal);
  }

  _show() {
    const [robot, { joints }] = [assertDefined(this._link.robot), assertDefined(this._link.state)];
    if (this._built !== robot) this._build(robot);
    this._rows.forEach(({ set, now }, i) => {
      setText(set, fixed(joints[i]?.setpoint, 2));
      setText(now, fixed(joints[i]?.value, 2));
    });
  }

  /** @param {RobotInfo} robot */
  _build(robot) {
    this._built = robot;
    this._rows = robot.joints.map(() => ({ set: el("td.value"), now: el("td.value") }));
    const head = ["", "set-point", "measured", ""].map((name) => el("th", { scope: "col" }, name));
    const lines = robot.joints.map(({ name, unit }, i) => {
      const { set, now } = this._rows[i];
      return el("tr", el("th", { scope: "row" }, name), set, now, el("td.unit", unit));
    });
    this._table.replaceChildren(el("thead", el("tr", ...head)), el("tbody", ...lines));
  }
}
