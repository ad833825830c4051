// A wheel that contradicts the others: said for as long as the robot suspects it, and a while longer,
// so that it can be read.

import { el, icon, mark, say } from "./dom.js";
import { fixed } from "./format.js";

const READ_MS = 4000;
const SHUT_OFF = new Set(["disarmed", "stopped", "fault"]);
const OFF_DEG = 0.5; // A gimbal that is this far from where it should be does not follow.

export class Conflict {
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
    link.on("state", () => this._draw());
    link.on("beat", () => this._hide());
    link.on("robot", () => ((this._untilMs = -Infinity), this._hide()));
  }

  _draw() {
    const { suspect } = this._link.state.status.conflict;
    if (suspect === null) return;
    this._untilMs = performance.now() + READ_MS;
    const { word, number, why } = accuse(this._link, suspect);
    say(this._what, `${word} ${number} ${why === null ? "contradicts the others" : "does not follow"}`);
    say(this._then, why ?? "It is not where the others say that it must be.");
    mark(this.element, "data-suspect", suspect);
    this.element.hidden = false;
  }

  _hide() {
    if (this.element.hidden || performance.now() < this._untilMs) return;
    this.element.hidden = true;
    mark(this.element, "data-suspect", null);
    say(this._what, ""); // So that it is said again, next time.
  }
}

/** Return how a suspect is called in the page, and what can be seen to be wrong with it. */
export function accuse({ robot, state }, suspect) {
  const number = robot.modules.indexOf(suspect) + 1;
  if (number === 0)
    return { word: "Wheel", number: robot.wheels.indexOf(suspect) + 1, why: null };
  return { word: "Module", number, why: stuck(state.modules[number - 1], state.status.mode) };
}

function stuck(module, mode) {
  if (module === undefined) return null;
  const [name, off] = [
    ["α", module.alpha - module.set_alpha],
    ["β", module.beta - module.set_beta],
  ].reduce((worst, other) => (Math.abs(other[1]) > Math.abs(worst[1]) ? other : worst));
  if (Math.abs(off) < OFF_DEG) return null;
  return (
    `Its gimbal ${name} is ${fixed(Math.abs(off), 1)}° from where it should be` +
    (SHUT_OFF.has(mode)
      ? ". The wheels are shut off."
      : ", and its wheel pushes as long as it spins. STOP shuts the wheels off.")
  );
}
