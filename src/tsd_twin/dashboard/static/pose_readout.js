// Readout of the estimated pose and speed.

import { el, setText } from "./dom.js";
import { degrees, fixed } from "./format.js";

// What is read of a state for each space: groups of figures with name, unit and value.
/** @typedef {[string, string, (state: Partial<RobotState>) => string]} Reading */
/** @type {Record<RobotInfo["space"], Record<string, Reading[]>>} */
const READINGS = {
  floor: {
    Pose: [
      ["x", "m", ({ pose }) => fixed(pose?.[0], 2)],
      ["y", "m", ({ pose }) => fixed(pose?.[1], 2)],
      ["heading", "°", ({ pose }) => degrees(pose?.[2])],
    ],
    Speed: [
      ["v", "m/s", ({ twist }) => fixed(twist ? Math.hypot(twist[0], twist[1]) : undefined, 2)],
      ["ω", "rad/s", ({ twist }) => fixed(twist?.[2], 2)],
    ],
  },
  ball: {
    Pose: [["turned", "°", ({ ball }) => turned(ball)]],
    Speed: [
      ["ωx", "", ({ twist }) => fixed(twist?.[0], 2)],
      ["ωy", "", ({ twist }) => fixed(twist?.[1], 2)],
      ["ωz", "rad/s", ({ twist }) => fixed(twist?.[2], 2)],
    ],
  },
};

export class PoseReadout {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    /** @type {RobotInfo["space"] | null} */
    this._space = null;
    /** @type {[Element, Reading[2]][]} */
    this._cells = [];
    this.element = el("div", { class: "pose surface" });
    link.on("beat", () => this._draw()); // Half as often as states arrive.
    link.on("robot", () => this._build());
    this._build();
  }

  _build() {
    const space = this._link.robot?.space ?? "floor";
    if (space !== this._space) {
      this._space = space;
      this._cells = [];
      this.element.replaceChildren(
        ...Object.entries(READINGS[space]).map(([label, readings]) =>
          el(
            "span",
            { class: "figures", role: "status", "aria-live": "off", "aria-label": label },
            ...readings.map((reading) => this._figure(...reading)),
          ),
        ),
      );
    }
    this._draw();
  }

  /** @param {string} name @param {string} unit @param {Reading[2]} read */
  _figure(name, unit, read) {
    const value = el("span", { class: "value number" });
    this._cells.push([value, read]);
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
    const state = this._link.state ?? {};
    for (const [value, read] of this._cells) setText(value, read(state));
  }
}

/**
 * By how much a ball is turned from where it was built in, degrees.
 * @param {SphereState | null | undefined} ball
 */
function turned(ball) {
  if (!ball) return "–";
  const [w, x, y, z] = ball.wxyz;
  return fixed((2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w)) * 180) / Math.PI, 0);
}
