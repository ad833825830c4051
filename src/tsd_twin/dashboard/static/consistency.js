// Consistency of the wheels: warning with the suspected actuator, and a meter of the residual.

import { el, icon, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { known } from "./link.js";

// How much the wheels contradict one another: a figure, a bar, and a verdict in words.
const FULL_MPS = 0.1; // End of the bar.

export class ConsistencyMeter {
  /**
   * `word` is what a suspect is called, before its number.
   * @param {string} word
   */
  constructor(word) {
    this._word = word;
    this._residual = el("span", { class: "value" });
    this._fill = el("div");
    this._bar = el(
      "div",
      {
        class: "meter",
        role: "meter",
        "aria-label": "Conflict",
        "aria-valuemin": "0",
        "aria-valuemax": FULL_MPS,
      },
      this._fill,
    );
    this._verdict = el("p", { class: "verdict" });
    this.elements = [
      el(
        "div",
        { class: "head" },
        el("strong", {}, "Conflict"),
        this._residual,
        el("span", { class: "unit" }, "m/s"),
      ),
      this._bar,
      this._verdict,
    ];
  }

  /**
   * Show the conflict of a state; `names` are all that it may suspect, `peace` is the text without a suspect.
   * @param {ConsistencyStatus} consistency
   * @param {string[]} names
   * @param {string} peace
   */
  show({ residual_mps: residual, suspect }, names, peace) {
    setText(this._residual, fixed(residual, 3));
    this._fill.style.transform = `scaleX(${Math.min(1, residual / FULL_MPS)})`;
    setAttribute(this._bar, "aria-valuenow", residual);
    setAttribute(this._bar, "data-suspect", suspect === null ? null : "");
    const number = names.indexOf(suspect ?? "") + 1;
    setText(
      this._verdict,
      suspect === null ? peace : `${this._word} ${number} contradicts the others.`,
    );
  }
}

// A wheel that contradicts the others: said for as long as the robot suspects it, and a while longer,
// so that it can be read.
const READ_MS = 4000;
const SHUT_OFF = new Set(["disarmed", "stopped", "fault"]);
const OFF_DEG = 0.5; // A gimbal that is this far from where it should be does not follow.

export class ConsistencyWarning {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._untilMs = -Infinity;
    this._what = el("strong", { role: "alert" });
    this._then = el("span", { class: "then" });
    this.element = el(
      "div",
      { class: "conflict surface", hidden: true },
      icon("fault"),
      el("div", { class: "what" }, this._what, this._then),
    );
    link.on("state", (state) => this._draw(state));
    link.on("beat", () => this._hide());
    link.on("robot", () => ((this._untilMs = -Infinity), this._hide()));
  }

  /** @param {RobotState} state */
  _draw(state) {
    const { suspect } = state.status.consistency;
    if (suspect === null) return;
    this._untilMs = performance.now() + READ_MS;
    const { word, number, why } = describeSuspect(this._link, suspect);
    setText(
      this._what,
      `${word} ${number} ${why === null ? "contradicts the others" : "does not follow"}`,
    );
    setText(this._then, why ?? "It is not where the others say that it must be.");
    setAttribute(this.element, "data-suspect", suspect);
    this.element.hidden = false;
  }

  _hide() {
    if (this.element.hidden || performance.now() < this._untilMs) return;
    this.element.hidden = true;
    setAttribute(this.element, "data-suspect", null);
    setText(this._what, ""); // So that it is said again, next time.
  }
}

/**
 * Return how a suspect is called in the page, and what can be seen to be wrong with it.
 * @param {{ robot: RobotInfo | null, state: RobotState | null }} link
 * @param {string} suspect
 * @returns {{ word: string, number: number, why: string | null }}
 */
export function describeSuspect(link, suspect) {
  const [robot, state] = [known(link.robot), known(link.state)];
  const number = robot.modules.indexOf(suspect) + 1;
  if (number === 0) return { word: "Wheel", number: robot.wheels.indexOf(suspect) + 1, why: null };
  return { word: "Module", number, why: stuck(state.modules[number - 1], state.status.mode) };
}

/** @param {GimbalState | undefined} module @param {string} mode */
function stuck(module, mode) {
  if (module === undefined) return null;
  /** @type {[string, number][]} */
  const angles = [
    ["α", module.alpha - module.set_alpha],
    ["β", module.beta - module.set_beta],
  ];
  const [name, off] = angles.reduce((worst, other) =>
    Math.abs(other[1]) > Math.abs(worst[1]) ? other : worst,
  );
  if (Math.abs(off) < OFF_DEG) return null;
  return (
    `Its gimbal ${name} is ${fixed(Math.abs(off), 1)}° from where it should be` +
    (SHUT_OFF.has(mode)
      ? ". The wheels are shut off."
      : ", and its wheel pushes as long as it spins. STOP shuts the wheels off.")
  );
}
