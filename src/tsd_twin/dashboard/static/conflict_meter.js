// How much the wheels contradict one another: a figure, a bar, and a verdict in words.

import { el, mark, say } from "./dom.js";
import { fixed } from "./format.js";

const FULL_MPS = 0.1; // End of the bar.

export class ConflictMeter {
  /** `word` is what a suspect is called, before its number. */
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

  /** Show the conflict of a state; `names` are all that it may suspect, `peace` is for nobody. */
  show({ residual_mps: residual, suspect }, names, peace) {
    say(this._residual, fixed(residual, 3));
    this._fill.style.transform = `scaleX(${Math.min(1, residual / FULL_MPS)})`;
    mark(this._bar, "aria-valuenow", residual);
    mark(this._bar, "data-suspect", suspect === null ? null : "");
    const number = names.indexOf(suspect) + 1;
    say(this._verdict, suspect === null ? peace : `${this._word} ${number} contradicts the others.`);
  }
}
