// Rotates a sphere until a selected point is on top: a motion source that stops at the goal, when any
// other control is used, or on release.

import { rotated } from "./twist_mapping.js";

const CLICK_MS = 3000; // The word of a click comes by way of the server.
const TIMEOUT_MS = 30000;
const NEAR_RAD = 0.01;
const APPROACH_PER_S = 2;

export class SphereGoTo {
  /** @param {Drive} drive @param {Link} link @param {(event: Event) => boolean} isScene */
  constructor(drive, link, isScene) {
    this._drive = drive;
    this._link = link;
    /** @type {{ at: Triple, untilMs: number } | null} */
    this._goal = null;
    this._clickedMs = -Infinity;
    addEventListener(
      "pointerdown",
      (event) => {
        if (isScene(event)) this._clickedMs = performance.now();
      },
      { capture: true },
    );
    link.on("point", (message) => this._take(message));
    link.on("robot", () => this.cancel());
    link.on("state", () => this._check());
  }

  get held() {
    return this._goal !== null;
  }

  /** The angular velocity that brings it up by the shortest way, rad/s, in the base. */
  get twist() {
    const way = this._rotation();
    if (way === null) return { vx: 0, vy: 0, omega: 0 };
    const rate = Math.min(APPROACH_PER_S * way.angle, this._drive.scale.speed);
    return { vx: rate * way.axis[0], vy: rate * way.axis[1], omega: 0 };
  }

  /**
   * Bring a point up: a unit vector along the axes that are painted on the sphere.
   * @param {Triple} at
   */
  bring(at) {
    this._goal = { at, untilMs: performance.now() + TIMEOUT_MS };
    this._drive.changed();
  }

  cancel() {
    this._goal = null;
  }

  /** @param {SphereClick} click */
  _take({ robot, at }) {
    const now = performance.now();
    const asked = now - this._clickedMs < CLICK_MS;
    this._clickedMs = -Infinity; // One click, one motion.
    if (asked && robot === this._link.robot?.id) this.bring(at);
  }

  _check() {
    if (this._goal === null) return;
    const way = this._rotation();
    if (way === null || way.angle < NEAR_RAD || performance.now() > this._goal.untilMs) {
      this.cancel();
      this._drive.changed();
    }
  }

  /** Where the point is now says which way is up: about a level axis, by the angle from above. */
  _rotation() {
    const ball = this._link.state?.ball;
    if (!ball || this._goal === null) return null;
    const [x, y, z] = rotated(ball.wxyz, this._goal.at);
    const level = Math.hypot(x, y);
    const angle = Math.atan2(level, z);
    if (level < 1e-6) return { angle: z > 0 ? 0 : angle, axis: [0, 1] };
    return { angle, axis: [y / level, -x / level] };
  }
}
