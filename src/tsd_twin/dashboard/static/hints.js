// Three short hints on the first visit, each until it has been followed; then never again.

import { Button } from "./button.js";
import { el, setText } from "./dom.js";
import { known } from "./link.js";

const KEY = "tsd.hints";

export class Hints {
  /** @param {Link} link @param {Hint[]} steps */
  constructor(link, steps) {
    this._steps = steps;
    this._link = link;
    this._isBusy = () => false;
    /** @type {HTMLElement | null} */
    this._bar = null;
    /** @type {HTMLElement[]} */
    this._controls = [];
    this._at = 0;
    this._text = el("p");
    this._count = el("span.number");
    const next = new Button("Next", () => this._go(this._at + 1), { kind: "quiet" });
    const skip = new Button("Skip", () => this._go(steps.length), { kind: "quiet" });
    this.element = el(
      "div.hint",
      { hidden: true, role: "note", "aria-label": "Hint" },
      this._text,
      el("div.row", this._count, skip.element, next.element),
      el("div.arrow"),
    );
    if (remembered()) return;
    link.on("state", () => this._draw());
    link.on("down", () => (this.element.hidden = true));
  }

  /**
   * Show none while `isBusy()`, nor over the bar and `controls` at the bottom, which keep their clicks.
   * @param {() => boolean} isBusy @param {HTMLElement} bar @param {HTMLElement[]} controls
   */
  keepClear(isBusy, bar, controls) {
    this._isBusy = isBusy;
    this._bar = bar;
    this._controls = controls;
  }

  /** @param {number} step */
  _go(step) {
    this._at = step;
    if (step >= this._steps.length) remember();
    this._draw();
  }

  _draw() {
    const state = known(this._link.state);
    while (this._at < this._steps.length && this._steps[this._at].done(state)) this._at += 1;
    const step = this._steps[this._at];
    if (step === undefined) remember();
    const isOut = this._link.isStale() || this._isBusy();
    this.element.hidden = step === undefined || isOut || !step.when(state);
    if (this.element.hidden) return;
    setText(this._text, step.text);
    setText(this._count, `${this._at + 1} of ${this._steps.length}`);
    this._place(step.target);
  }

  /** @param {Element} target */
  _place(target) {
    const frame = known(this.element.parentElement).getBoundingClientRect();
    const box = target.getBoundingClientRect();
    const own = this.element.getBoundingClientRect();
    const centre = box.left + box.width / 2 - frame.left;
    const x = Math.max(8, Math.min(frame.width - own.width - 8, centre - own.width / 2));
    const isBelow = box.top - frame.top < frame.height / 2;
    const tops = this._controls
      .filter(({ hidden }) => !hidden)
      .map((control) => control.getBoundingClientRect().top);
    const lowest = Math.min(...tops) - frame.top - own.height - 12;
    const { bottom } = (this._bar ?? target).getBoundingClientRect();
    const y = isBelow ? bottom - frame.top + 12 : lowest;
    this.element.hidden = y > lowest || y < 0; // There is no room for it.
    this.element.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px)`;
    this.element.style.setProperty("--at", `${Math.round(centre - x)}px`);
    this.element.dataset.side = isBelow ? "below" : "above";
  }
}

function remembered() {
  try {
    return localStorage.getItem(KEY) !== null;
  } catch {
    return true; // Without a memory, hints would come back each time.
  }
}

function remember() {
  try {
    localStorage.setItem(KEY, "seen");
  } catch {
    // Then they come back.
  }
}
