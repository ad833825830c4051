// Sphere robot: its tab with the orientation and both contact models, and the motion that brings a
// point to the top.

import { el, isVisible, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";
import { assertDefined } from "./link.js";
import { driveBlockedReason } from "./blocked_reasons.js";
import { EstimateDifference, WheelList } from "./wheels.js";

const RADIUS = 40; // In the drawing.
/** @type {[string, Triple, string][]} */
const ENDS = [
  ["front", [1, 0, 0], "front"],
  ["plain", [-1, 0, 0], "back"],
  ["plain", [0, 1, 0], "left"],
  ["plain", [0, -1, 0], "right"],
  ["up", [0, 0, 1], "top"],
  ["plain", [0, 0, -1], "bottom"],
];
const AXES = ["ωx", "ωy", "ωz"];
const ROWS = ["–", "first", "second"];

const CLICK_MS = 3000; // Allows for the delay of the server's click message.
const TIMEOUT_MS = 30000;
const NEAR_RAD = 0.01;
const APPROACH_PER_S = 2;

export class Sphere {
  /**
   * @param {Link} link @param {HTMLElement} place @param {AbortSignal} signal
   * @param {SphereGoTo} sphereGoTo
   */
  constructor(link, place, signal, sphereGoTo) {
    this._link = link;
    this._marks = ENDS.map(([name]) => svg(`circle.${name}`, { r: 5 }));
    const globe = svg(
      "svg.globe",
      { viewBox: "-50 -50 100 100", role: "img" },
      { "aria-label": "The sphere from above, forward up, with the marks that it has" },
      svg("circle.limit", { r: RADIUS }),
      svg("path.cross", { d: `M0 ${-RADIUS}V${RADIUS}M${-RADIUS} 0H${RADIUS}` }),
      ...this._marks,
    );
    this._cells = AXES.map(() => [el("td.value"), el("td.value")]);
    const rows = AXES.map((name, i) =>
      el("tr", el("th", { scope: "row" }, name), ...this._cells[i]),
    );
    const heads = ["rad/s", "ideal", "dual"].map((name) => el("th", { scope: "col" }, name));
    const table = el(
      "table.models",
      { "aria-label": "Angular velocity by the two models, rad/s" },
      el("thead", el("tr", ...heads)),
      el("tbody", ...rows),
    );
    this._buttons = ENDS.map(([, at, name]) =>
      el("button", { type: "button", onclick: () => sphereGoTo.bring(at) }, name),
    );
    this._between = el("p.verdict");
    this._rows = el("p.verdict");
    this._list = new WheelList(link);
    this._difference = new EstimateDifference(link);
    place.append(
      el("div.sphere", globe, table),
      this._between,
      this._rows,
      this._difference.element,
      this._list.element,
      el("p.verdict", "Click on the sphere to bring that point up, or choose a mark:"),
      el("div.bring", { role: "group", "aria-label": "Bring up" }, ...this._buttons),
    );
    link.on("state", () => isVisible(place) && this._show(), signal);
  }

  _show() {
    this._list.show(null);
    this._difference.show();
    const refused = driveBlockedReason(this._link) === null ? null : "true";
    for (const button of this._buttons) setAttribute(button, "aria-disabled", refused);
    const { sphere } = assertDefined(this._link.state);
    if (sphere === null) return;
    this._marks.forEach((node, i) => put(node, rotated(sphere.wxyz, ENDS[i][1])));
    this._cells.forEach(([ideal, dual], i) => {
      setText(ideal, fixed(sphere.ideal[i], 2));
      setText(dual, fixed(sphere.dual?.[i], 2));
    });
    setText(
      this._between,
      `The two differ by ${fixed(sphere.angle_deg, 2)}° in direction, ` +
        `${fixed(sphere.magnitude_percent, 2)} % in size.`,
    );
    setText(this._rows, `Rows in contact: ${sphere.rows.map((row) => ROWS[row]).join(", ")}.`);
  }
}

/**
 * Place a mark as seen from above, x up and y left; marks below are faint.
 * @param {Element} node @param {Triple} point
 */
function put(node, [x, y, z]) {
  setAttribute(node, "cx", (-y * RADIUS).toFixed(2));
  setAttribute(node, "cy", (-x * RADIUS).toFixed(2));
  node.toggleAttribute("data-below", z < 0);
}

/**
 * Motion source that rotates a sphere until a point is on top; ended by another control or release.
 */
export class SphereGoTo {
  /** @param {Drive} drive @param {Link} link @param {(event: Event) => boolean} isScene */
  constructor(drive, link, isScene) {
    this._drive = drive;
    this._link = link;
    /** @type {{ at: Triple, untilMs: number } | null} */
    this._goal = null;
    this._clickedMs = -Infinity;
    const clicked = (/** @type {Event} */ event) => {
      if (isScene(event)) this._clickedMs = performance.now();
    };
    addEventListener("pointerdown", clicked, { capture: true });
    link.on("sphere_click", (message) => this._take(message));
    link.on("robot", () => this.cancel());
    link.on("state", () => this._check());
  }

  get held() {
    return this._goal !== null;
  }

  /** Angular velocity (rad/s, in the base) that brings the point up by the shortest rotation. */
  get twist() {
    const way = this._rotation();
    if (way === null) return { vx: 0, vy: 0, omega: 0 };
    const rate = Math.min(APPROACH_PER_S * way.angle, this._drive.scale.speed);
    return { vx: rate * way.axis[0], vy: rate * way.axis[1], omega: 0 };
  }

  /** Bring a point, given in the painted axes, to the top. @param {Triple} at */
  bring(at) {
    this._goal = { at, untilMs: performance.now() + TIMEOUT_MS };
    this._drive.changed();
  }

  cancel() {
    this._goal = null;
  }

  /** @param {SphereClick} click */
  _take({ robot, at }) {
    const isOwn = performance.now() - this._clickedMs < CLICK_MS;
    this._clickedMs = -Infinity; // One motion per click.
    if (isOwn && robot === this._link.robot?.id) this.bring(at);
  }

  _check() {
    if (this._goal === null) return;
    const way = this._rotation();
    if (way === null || way.angle < NEAR_RAD || performance.now() > this._goal.untilMs) {
      this.cancel();
      this._drive.changed();
    }
  }

  /** Remaining rotation: about a horizontal axis, by the angle of the point from the top. */
  _rotation() {
    const sphere = this._link.state?.sphere;
    if (!sphere || this._goal === null) return null;
    const [x, y, z] = rotated(sphere.wxyz, this._goal.at);
    const level = Math.hypot(x, y);
    const angle = Math.atan2(level, z);
    if (level < 1e-6) return { angle: z > 0 ? 0 : angle, axis: [0, 1] };
    return { angle, axis: [y / level, -x / level] };
  }
}

/**
 * Rotate a vector by a unit quaternion w, x, y, z.
 * @param {Quaternion} turn @param {Triple} vector
 * @returns {Triple}
 */
function rotated([w, x, y, z], [a, b, c]) {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}
