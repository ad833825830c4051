// Wheel consistency: a meter for the residual, and a warning naming the suspected actuator.

import { el, icon, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { assertDefined } from "./link.js";

const FULL_MPS = 0.1; // End of the bar.
const READ_MS = 4000; // Minimum duration of a warning after its cause ends.
const SHUT_OFF = new Set(["disarmed", "stopped", "fault"]);
const OFF_DEG = 0.5; // Gimbal errors above this mean that it does not follow.

/** Inconsistency between wheels: value, bar and verdict. */
export class ConsistencyMeter {
  /** `word` precedes the number of a suspect. @param {string} word */
  constructor(word) {
    this._word = word;
    this._residual = el("span.value");
    this._fill = el("div");
    const range = { "aria-valuemin": 0, "aria-valuemax": FULL_MPS, "aria-valuenow": 0 };
    this._bar = el(
      "div.meter",
      { role: "meter", "aria-label": "Consistency", ...range },
      this._fill,
    );
    this._verdict = el("p.verdict");
    const head = el(
      "div.head",
      el("strong", "Consistency"),
      this._residual,
      el("span.unit", "m/s"),
    );
    this.elements = [head, this._bar, this._verdict];
  }

  /**
   * Show the consistency of a state; `names` are all that it may suspect.
   * @param {ConsistencyStatus} consistency @param {string[]} names
   * @param {string} agreement The verdict without a suspect.
   */
  show({ residual_mps: residual, suspect }, names, agreement) {
    setText(this._residual, fixed(residual, 3));
    this._fill.style.transform = `scaleX(${Math.min(1, residual / FULL_MPS)})`;
    setAttribute(this._bar, "aria-valuenow", residual);
    this._bar.toggleAttribute("data-suspect", suspect !== null);
    const number = names.indexOf(suspect ?? "") + 1;
    const verdict = `${this._word} ${number} contradicts the others.`;
    setText(this._verdict, suspect === null ? agreement : verdict);
  }
}

/**
 * Warning about an inconsistent wheel, shown while the robot suspects it and briefly afterwards.
 */
export class ConsistencyWarning {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._untilMs = -Infinity;
    this._what = el("strong", { role: "alert" });
    this._then = el("span.then");
    const text = el("div.what", this._what, this._then);
    this.element = el("div.consistency.surface", { hidden: true }, icon("fault"), text);
    link.on("state", (state) => this._draw(state));
    link.on("beat", () => this._hide());
    link.on("robot", () => ((this._untilMs = -Infinity), this._hide()));
  }

  /** @param {RobotState} state */
  _draw(state) {
    const { suspect } = state.status.consistency;
    if (suspect === null) return;
    this._untilMs = performance.now() + READ_MS;
    const { name, reason } = describeSuspect(assertDefined(this._link.robot), state, suspect);
    setText(
      this._what,
      `${name} ${reason === null ? "contradicts the others" : "does not follow"}`,
    );
    setText(this._then, reason ?? "Its speed does not fit the motion of the others.");
    setAttribute(this.element, "data-suspect", suspect);
    this.element.hidden = false;
  }

  _hide() {
    if (this.element.hidden || performance.now() < this._untilMs) return;
    this.element.hidden = true;
    setAttribute(this.element, "data-suspect", null);
    setText(this._what, ""); // So that it is announced again next time.
  }
}

/**
 * Return the name of a suspect on the page, and its visible error.
 * @param {RobotInfo} robot @param {RobotState} state @param {string} suspect
 */
function describeSuspect(robot, state, suspect) {
  const at = robot.modules.indexOf(suspect);
  if (at < 0) return { name: `Wheel ${robot.wheels.indexOf(suspect) + 1}`, reason: null };
  return { name: `Module ${at + 1}`, reason: gimbalError(state.modules[at], state.status.mode) };
}

/** @param {GimbalState | undefined} module @param {string} mode */
function gimbalError(module, mode) {
  if (module === undefined) return null;
  const [alpha, beta] = [
    module.alpha - module.alpha_setpoint,
    module.beta - module.beta_setpoint,
  ].map(Math.abs);
  const off = Math.max(alpha, beta);
  if (off < OFF_DEG) return null;
  const end = SHUT_OFF.has(mode)
    ? ". The wheels are shut off."
    : ", and its wheel pushes as long as it spins. STOP shuts the wheels off.";
  return `Its gimbal ${beta > alpha ? "β" : "α"} is ${fixed(off, 1)}° from where it should be${end}`;
}
