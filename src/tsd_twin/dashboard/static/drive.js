// Maps controls to commands. Each motion source (stick, turn slider, keys, gamepad, panel) has

import { kindOf } from "./kinds.js";
import { assertDefined } from "./link.js";
import { LATCHED, stopBlockedReason, whyNotDrive } from "./blocked_reasons.js";
import { retryNotice, isToldElsewhere, notice } from "./reasons.js";
import { noteMotion } from "./reload_note.js";

/** @typedef {import("./blocked_reasons.js").Refusal} Refusal */
/** @typedef {import("./reasons.js").Notice} Notice */

/** Whether the robot moves or is stopping. @param {RobotState} state */
const isMoving = ({ status }) => status.mode === "driving" || status.mode === "stopping";

const PERIOD_MS = 20;
const MIN_SEND_INTERVAL_MS = 9.5; // Timers may fire a few tenths of a millisecond early.
const STOP_RETRY_MS = 200;
const STOP_CONFIRM_MS = 600;
const STOP_RETRY_LIMIT_MS = 5000;
const STATES_IN_FLIGHT = 20; // One second of states.

export class Drive {
  /** @param {Link} link */
  constructor(link) {
    this.link = link;
    this.level = 50;
    /** @type {"base_link" | "odom"} */
    this.frame = "base_link";
    /** @type {(notice: Notice, isTrue?: () => boolean) => void} */
    this.onMessage = () => {};
    /** @type {MotionSource[]} */
    this._sources = [];
    /** @type {(() => void)[]} */
    this._listeners = [];
    this._timer = 0; // Zero while nothing is held.
    this._sentMs = -Infinity;
    /**
     * @type {{ robot: string | undefined, sinceMs: number, sentMs: number, doubted: boolean,
     *   latchedAt: number | null } | null}
     */
    this._stop = null; // Pending until confirmed.
    link.on("state", (state) => this._checkState(state));
    link.on("beat", () => this._retryStop());
    const lost = notice("The connection is lost.");
    link.on("down", () => this.release(lost, false, () => !link.connected));
    link.on("released", ({ why }) => {
      this.release(isToldElsewhere(why) ? null : retryNotice(why), true);
    });
    link.on("reply", ({ to, ok }) => {
      if (to === "stop" && ok) this._confirmStop();
    });
    addEventListener("blur", () => this.release());
    addEventListener("pagehide", () => {
      const moved = this.held || (link.state?.has_control && isMoving(link.state));
      this.release();
      if (moved) noteMotion();
    });
    document.addEventListener("visibilitychange", () => this.release());
  }

  /** @param {MotionSource} source */
  add(source) {
    this._sources.push(source);
  }

  /** @param {() => void} listener */
  onChange(listener) {
    this._listeners.push(listener);
  }

  get held() {
    return this._timer !== 0;
  }

  /** Value of a full deflection: level times the active limits. */
  get scale() {
    const limits = this.link.state?.status.limits;
    const share = this.level / 100;
    return {
      speed: (share * (limits?.speed_mps ?? 0)) / (this.link.robot?.twist_scale_m ?? 1),
      turn: share * (limits?.turn_rate_rad_per_s ?? 0),
    };
  }

  /** Combined control input, each axis in [-1, 1]. */
  get unit() {
    let [x, y, turn] = [0, 0, 0];
    for (const { unit } of this._sources) {
      if (unit === undefined) continue;
      x += unit.x;
      y += unit.y;
      turn += unit.turn;
    }
    const length = Math.max(1, Math.hypot(x, y));
    return { x: x / length, y: y / length, turn: Math.max(-1, Math.min(1, turn)) };
  }

  /**
   * Requested twist (3 components), m/s and rad/s.
   * @returns {Omit<DriveCommand, "t">}
   */
  get twist() {
    const panel = this._sources.find((source) => source.held && source.twist !== undefined);
    if (panel?.twist !== undefined) return { ...panel.twist, frame: "base_link" };
    const { unit, scale } = this;
    const sideways = this.link.robot?.sideways === false ? 0 : unit.y;
    const [vx, vy, omega] = kindOf(this.link.robot).controls.twist(
      unit.x * scale.speed,
      sideways * scale.speed,
      unit.turn * scale.turn,
    );
    return { vx, vy, omega, frame: this.frame };
  }

  /** Update the motion after a source changed. Using any hand control ends latched motion. */
  changed() {
    const handControl = this._sources.some((source) => source.held && source.twist === undefined);
    if (handControl)
      for (const source of this._sources) if (source.twist !== undefined) source.cancel();
    const held = this._sources.some((source) => source.held);
    if (held && !this.held) this._start();
    else if (!held && this.held) this._finish();
    else if (held) this._send();
    this._notify();
  }

  /** A control is held that cannot drive now: release it and say why. @param {Refusal} refusal */
  _refuse({ why, text }) {
    const message = isToldElsewhere(why) ? null : retryNotice(why, text);
    this.release(message, false, this._isStill(why.code));
  }

  /** @param {string} code @returns {() => boolean} */
  _isStill(code) {
    return () => whyNotDrive(this.link)?.why.code === code;
  }

  /**
   * Centre all controls; each must be released before it acts again.
   * @param {Notice | null} [message] @param {boolean} [byServer] @param {() => boolean} [isTrue]
   */
  release(message = null, byServer = false, isTrue = undefined) {
    const wasHeld = this.held;
    for (const source of this._sources) source.cancel();
    if (this.held) this._finish();
    else if (byServer) this.link.send({ t: "release" });
    this._notify();
    if (message !== null && (wasHeld || byServer)) this.onMessage(message, isTrue);
  }

  /**
   * Whether the robot has not confirmed a stop in time and the operator has not acknowledged that.
   */
  get stopUnconfirmed() {
    return this._stop?.doubted ?? false;
  }

  acknowledgeStop() {
    this._stop = null;
    this._notify();
  }

  /** Stop the robot immediately, in every state, retrying until acknowledged. */
  stop() {
    const reason = stopBlockedReason(this.link);
    if (reason !== null) {
      this.onMessage(notice(reason));
      return;
    }
    const now = performance.now();
    const doubted = this.stopUnconfirmed; // Keep an earlier alarm until a stop is confirmed.
    const before = this.link.state;
    const latchedAt = before && LATCHED.has(before.status.mode) ? before.status_seq : null;
    this._stop = { robot: this.link.robot?.id, sinceMs: now, sentMs: now, doubted, latchedAt };
    this.link.send({ t: "stop" });
    this.release();
  }

  _start() {
    const refusal = whyNotDrive(this.link);
    if (refusal !== null) {
      for (const source of this._sources) source.cancel();
      this.onMessage(notice(refusal.text), this._isStill(refusal.why.code));
      return;
    }
    this._timer = setInterval(() => this._send(), PERIOD_MS);
    this._send();
  }

  _finish() {
    clearInterval(this._timer);
    this._timer = 0;
    this.link.send({ t: "release" });
  }

  _send() {
    const refusal = whyNotDrive(this.link);
    if (refusal !== null) {
      this._refuse(refusal);
      return;
    }
    const now = performance.now();
    if (now - this._sentMs < MIN_SEND_INTERVAL_MS) return;
    this._sentMs = now;
    this.link.send({ ...this._command, status_seq: assertDefined(this.link.state).status_seq });
  }

  /** @returns {DriveCommand | FollowPlan} */
  get _command() {
    const source = this._sources.find(({ held, command }) => held && command !== undefined);
    return source?.command ?? { t: "drive", ...this.twist };
  }

  /** @param {RobotState} state */
  _checkState(state) {
    const refusal = this.held ? whyNotDrive(this.link) : null;
    const isLatched = LATCHED.has(state.status.mode);
    if (refusal !== null && isLatched)
      this.release(); // A card shows the details.
    else if (refusal !== null) this._refuse(refusal);
    // Recorded states confirm nothing, and states of several robots are ambiguous.
    if (isLatched && state.source === "robot" && !this._isOld(state)) this._confirmStop();
    this._notify();
  }

  /**
   * Whether a state may predate the stop. A robot that was already latched may have been reset
   * while its state was in flight. Its reply confirms the stop, or a state well after it.
   * @param {RobotState} state
   */
  _isOld({ status_seq: seen }) {
    const latchedAt = this._stop?.latchedAt ?? null;
    return latchedAt !== null && seen >= latchedAt && seen - latchedAt < STATES_IN_FLIGHT;
  }

  /** Confirm the stop of the displayed robot; a stop of another robot stays pending. */
  _confirmStop() {
    if (this._stop === null || this._stop.robot !== this.link.robot?.id) return;
    this._stop = null;
    this._notify();
  }

  _retryStop() {
    if (this._stop === null) return;
    const now = performance.now();
    const ageMs = now - this._stop.sinceMs;
    const isDue = now - this._stop.sentMs > STOP_RETRY_MS && ageMs <= STOP_RETRY_LIMIT_MS;
    if (isDue && this.link.send({ t: "stop" })) this._stop.sentMs = now;
    if (ageMs <= STOP_CONFIRM_MS || this._stop.doubted) return;
    this._stop.doubted = true;
    this._notify();
  }

  _notify() {
    for (const listener of this._listeners) listener();
  }
}
