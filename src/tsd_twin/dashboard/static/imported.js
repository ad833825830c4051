// Third-party ROS robot: commanded and reported speeds, and its limitations.

import { el, isVisible, setText } from "./dom.js";
import { fixed } from "./format.js";
import { assertDefined } from "./link.js";

export class Imported {
  /** @param {Link} link @param {HTMLElement} place @param {AbortSignal} signal */
  constructor(link, place, signal) {
    this._link = link;
    this._built = null;
    /** @type {{ set: HTMLElement, now: HTMLElement }[]} */
    this._rows = [];
    this._twist = el("table.twist");
    this._sentences = el("ul");
    const title = el("strong", "Not promised for this robot");
    place.append(this._twist, el("section.not-promised", title, this._sentences));
    link.on("state", () => isVisible(place) && this._show(), signal);
  }

  _show() {
    const [robot, { commanded, twist }] = [
      assertDefined(this._link.robot),
      assertDefined(this._link.state),
    ];
    if (this._built !== robot) this._build(robot);
    this._rows.forEach(({ set, now }, i) => {
      setText(set, fixed(commanded?.[i], 2));
      setText(now, fixed(twist?.[i], 2));
    });
  }

  /** @param {RobotInfo} robot */
  _build(robot) {
    this._built = robot;
    this._rows = robot.twist_axes.map(() => ({ set: el("td.value"), now: el("td.value") }));
    const head = ["", "cmd_vel", "odom", ""].map((name) => el("th", { scope: "col" }, name));
    const lines = robot.twist_axes.map(({ symbol, unit }, i) => {
      const { set, now } = this._rows[i];
      return el("tr", el("th", { scope: "row" }, symbol), set, now, el("td.unit", unit));
    });
    this._twist.replaceChildren(el("thead", el("tr", ...head)), el("tbody", ...lines));
    this._sentences.replaceChildren(...robot.not_promised.map((text) => el("li", text)));
  }
}
