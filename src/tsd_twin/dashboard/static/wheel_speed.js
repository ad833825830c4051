// Speed of continuously spinning wheels: benefits and costs.

import { el, isVisible, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { assertDefined } from "./link.js";
import { wheelSpeedBlockedReason } from "./blocked_reasons.js";

const STEP_RPM = 50;
const KEPT_MS = 1500; // Maximum time to show a chosen value before the robot confirms it.
const CHANGING_RPM = 15;
const DEGREE = Math.PI / 180;

export class WheelSpeed {
  /** @param {Link} link @param {ShadowRoot} place @param {AbortSignal} signal */
  constructor(link, place, signal) {
    this._link = link;
    this._draft = null; // Value being edited or recently chosen.
    this._keptMs = -Infinity;
    this._asking = false;
    this._next = null;
    this._slider = this._input("range", STEP_RPM, "Drive speed");
    this._rpm = this._input("number", 1, "Drive speed, rpm");
    this._top = this._input("number", 0.1, "Drive speed, up to m/s");
    this._now = el("span.value.muted");
    this._figures = el("p.figures", { role: "status", "aria-label": "Drive speed" });
    this._why = el("p.muted");
    const unit = (/** @type {string} */ name) => el("span.unit", name);
    this._all = el(
      "section.wheel-speed",
      { "aria-label": "Drive speed" },
      el("div.head", el("strong", "Drive speed"), this._now),
      this._slider,
      el(
        "div.fields",
        el("label", this._rpm, unit("rpm")),
        el("label", "up to", this._top, unit("m/s")),
      ),
      this._figures,
      this._why,
    );
    this._all.hidden = true;
    place.append(this._all);
    this._listen(this._slider, (value) => value);
    this._listen(this._rpm, (value) => value);
    // The slowest sufficient wheel speed allows the finest steps.
    this._listen(this._top, (value) => Math.ceil(value / this._topSpeed(1)));
    link.on("robot", () => this._build(), signal);
    link.on(["state", "beat", "down"], () => isVisible(place.host) && this._show(), signal);
    link.on("reply", ({ to }) => to === "wheel_speed" && this._answered(), signal);
    link.on(["down", "welcome"], () => (this._asking = false), signal);
    this._build();
  }

  /** @param {string} type @param {number} step @param {string} label */
  _input(type, step, label) {
    return el("input", { type, step, "aria-label": label, disabled: true });
  }

  /** @param {HTMLInputElement} input @param {(value: number) => number} rpmOf */
  _listen(input, rpmOf) {
    const take = () => {
      const rpm = rpmOf(Number(input.value));
      if (input.value === "" || !Number.isFinite(rpm)) return null;
      const { least_rpm: least, most_rpm: most } = assertDefined(
        assertDefined(this._link.robot).wheel_speed_limits,
      );
      return Math.round(Math.max(least, Math.min(most, rpm)));
    };
    input.addEventListener("input", () => {
      this._draft = take();
      this._keptMs = Infinity;
      this._draw(input);
    });
    input.addEventListener("blur", () => {
      if (this._keptMs === Infinity) this._keptMs = -Infinity; // The input was not a number.
    });
    input.addEventListener("change", () => {
      this._draft = take();
      this._keptMs = performance.now() + KEPT_MS;
      if (this._draft !== null) this._ask(this._draft);
      this._draw();
    });
  }

  /** @param {number} rpm */
  _ask(rpm) {
    if (this._asking) {
      this._next = rpm; // One request at a time; later values replace waiting ones.
      return;
    }
    this._asking = this._link.send({ t: "wheel_speed", cruise_speed_rpm: rpm });
  }

  _answered() {
    this._asking = false;
    const next = this._next;
    this._next = null;
    if (next !== null) this._ask(next);
  }

  _build() {
    const range = this._link.robot?.wheel_speed_limits ?? null;
    this._all.hidden = range === null;
    this._draft = null;
    if (range === null) return;
    for (const input of [this._slider, this._rpm]) {
      input.min = String(range.least_rpm);
      input.max = String(range.most_rpm);
    }
    this._top.min = fixed(Math.floor(10 * this._topSpeed(range.least_rpm)) / 10, 1);
    this._top.max = fixed(Math.ceil(10 * this._topSpeed(range.most_rpm)) / 10, 1);
    this._draw();
  }

  _show() {
    const speed = this._link.state?.status.wheel_speed ?? null;
    if (this._all.hidden || speed === null) return;
    const reason = wheelSpeedBlockedReason(this._link);
    for (const input of [this._slider, this._rpm, this._top]) input.disabled = reason !== null;
    setText(this._why, reason ?? "");
    if (this._draft === speed.requested_rpm || performance.now() > this._keptMs || reason !== null)
      this._draft = null;
    const off = speed.spin_rpm - speed.requested_rpm;
    const spins = speed.spin_rpm > 1;
    const now = Math.abs(off) > CHANGING_RPM ? `now ${thousands(speed.spin_rpm)} rpm` : "";
    setText(this._now, this._link.isStale() ? "" : spins ? now : "wheels stand");
    if (this._draft === null) this._draw();
  }

  /** Update all fields except the one being edited. @param {HTMLInputElement | null} but */
  _draw(but = null) {
    if (!this._link.robot?.wheel_speed_limits) return;
    const { wheel_speed_limits: range, limits, max_tilt_deg: tilt } = this._link.robot;
    const rpm =
      this._draft ?? this._link.state?.status.wheel_speed?.requested_rpm ?? range.default_rpm;
    const top = this._topSpeed(rpm);
    /** @type {[HTMLInputElement, string][]} */
    const shown = [
      [this._slider, String(Math.round(rpm))],
      [this._rpm, String(Math.round(rpm))],
      [this._top, top.toFixed(1)],
    ];
    const focused = /** @type {ShadowRoot} */ (this._all.getRootNode()).activeElement;
    for (const [input, text] of shown) {
      const typing = input === focused && this._keptMs === Infinity;
      if (input !== but && !typing && input.value !== text) input.value = text;
    }
    const summary = `${thousands(rpm)} rpm, up to ${fixed(top, 1)} m/s`;
    setAttribute(this._slider, "aria-valuetext", summary);
    const rim = this._rim(rpm);
    const step = 1000 * rim * range.servo_step_deg * DEGREE;
    const lean = Math.asin(Math.min(1, 1 / rim)) / DEGREE;
    const capped =
      limits.speed_mps < top
        ? ` The speed limit stays ${fixed(limits.speed_mps, 1)} m/s.`
        : ` That is less than the speed limit of ${fixed(limits.speed_mps, 1)} m/s.`;
    setText(
      this._figures,
      `${thousands(rpm)} rpm: up to ${fixed(top, 1)} m/s by tilt ${fixed(tilt, 0)}°, ` +
        `one servo step = ${fixed(step, 0)} mm/s, ` +
        (rim >= 1 ? `1 m/s needs ${fixed(lean, 1)}° tilt.` : "1 m/s is out of reach.") +
        capped,
    );
  }

  /** Rim speed of a wheel in m/s. @param {number} rpm */
  _rim(rpm) {
    return (
      (assertDefined(assertDefined(this._link.robot).wheel_speed_limits).wheel_radius_m *
        rpm *
        Math.PI) /
      30
    );
  }

  /** Ground speed at the tilt limit in m/s. @param {number} rpm */
  _topSpeed(rpm) {
    return (
      this._rim(rpm) *
      Math.sin(assertDefined(assertDefined(this._link.robot).max_tilt_deg) * DEGREE)
    );
  }
}

/** @param {number} number */
function thousands(number) {
  return Math.round(number).toLocaleString("en");
}
