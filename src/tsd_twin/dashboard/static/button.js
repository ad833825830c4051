// Buttons that show the reason while they are disabled.

import { el, setAttribute, setText } from "./dom.js";

const HOLD_MS = 1000;
let count = 0;

/** @typedef {{ tips: Tooltip, press: () => void, tip?: string, kind?: string }} ButtonOptions */

export class Button {
  /**
   * `press()` is called when it is used, `tip` tells what it does when nothing is in the way.
   * @param {string} label
   * @param {ButtonOptions} options
   */
  constructor(label, { tips, press, tip = "", kind = "" }) {
    /** @type {string | null} */
    this.reason = null;
    this._tips = tips;
    this._press = press;
    this._tip = tip;
    const id = `why-${(count += 1)}`;
    this._why = el("span", { class: "sr", id }, tip);
    this._label = el("span", { class: "label" }, label);
    this.button = el(
      "button",
      { type: "button", class: `button ${kind}`, "aria-describedby": id },
      this._label,
    );
    this.element = el("span", { class: "holder" }, this.button, this._why);
    this.button.addEventListener("click", (event) => this._click(event));
    tips.attach(this.button, () => this.reason ?? this._tip);
  }

  /**
   * Change what it says and does.
   * @param {string} label
   * @param {string} tip
   */
  become(label, tip) {
    setText(this._label, label);
    this._tip = tip;
  }

  /**
   * Let it be used, or not, with the reason.
   * @param {string | null} reason
   */
  allow(reason) {
    this.reason = reason;
    setAttribute(this.button, "aria-disabled", reason === null ? null : "true");
    setText(this._why, reason ?? this._tip);
  }

  use() {
    if (this.reason !== null) this._tips.show(this.button, () => this.reason ?? "");
    else this._press();
  }

  /** @param {MouseEvent} _event */
  _click(_event) {
    this.use();
  }
}

/** A button that has to be held for a second, by pointer or key. */
export class LongPressButton extends Button {
  /** @param {string} label @param {ButtonOptions} options */
  constructor(label, options) {
    super(label, { ...options, kind: `hold ${options.kind ?? ""}` });
    /** @type {number | undefined} */
    this._timer = undefined;
    this._pointerMs = -Infinity;
    this.button.style.setProperty("--hold", `${HOLD_MS}ms`);
    this.button.addEventListener("pointerdown", (event) => this._begin(event));
    for (const end of ["pointerup", "pointercancel", "pointerleave", "blur"]) {
      this.button.addEventListener(end, () => this._end());
    }
    this.button.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /**
   * Take Enter or the space bar while it has the focus; return whether it was one of them.
   * @param {KeyboardEvent} event
   */
  key(event) {
    if (event.code !== "Enter" && event.code !== "Space") return false;
    if (event.type === "keyup") this._end();
    else if (!event.repeat) this._start();
    return true;
  }

  /** @param {MouseEvent} event */
  _begin(event) {
    this._pointerMs = event.timeStamp;
    if (event.button === 0) this._start();
  }

  _start() {
    if (this.reason !== null) this.use(); // Show the reason; the hold decides when it ends.
    this._end();
    setAttribute(this.button, "data-holding", "");
    this._timer = setTimeout(() => {
      this._end();
      this.use();
    }, HOLD_MS);
  }

  _end() {
    clearTimeout(this._timer);
    setAttribute(this.button, "data-holding", null);
  }

  /**
   * Assistive technology presses without a pointer and cannot hold: that is deliberate enough.
   * @param {MouseEvent} event
   */
  _click(event) {
    if (event.timeStamp - this._pointerMs > 2 * HOLD_MS && event.detail === 0) this.use();
  }
}
