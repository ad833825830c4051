// Buttons that show the reason while they are disabled.

import { el, setAttribute, setText } from "./dom.js";

const HOLD_MS = 1000;
let count = 0;

export class Button {
  /** `press()` is called when it is used, `tip` tells what it does when nothing is in the way. */
  constructor(label, { tips, press, tip = "", kind = "" }) {
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

  /** Change what it says and does. */
  become(label, tip) {
    setText(this._label, label);
    this._tip = tip;
  }

  /** Let it be used, or not, with the reason. */
  allow(reason) {
    this.reason = reason;
    setAttribute(this.button, "aria-disabled", reason === null ? null : "true");
    setText(this._why, reason ?? this._tip);
  }

  use() {
    if (this.reason !== null) this._tips.show(this.button, () => this.reason ?? "");
    else this._press();
  }

  _click() {
    this.use();
  }
}

/** A button that has to be held for a second, by pointer or key. */
export class LongPressButton extends Button {
  constructor(label, options) {
    super(label, { ...options, kind: `hold ${options.kind ?? ""}` });
    this._timer = null;
    this._pointerMs = -Infinity;
    this.button.style.setProperty("--hold", `${HOLD_MS}ms`);
    this.button.addEventListener("pointerdown", (event) => this._begin(event));
    for (const end of ["pointerup", "pointercancel", "pointerleave", "blur"]) {
      this.button.addEventListener(end, () => this._end());
    }
    this.button.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /** Take Enter or the space bar while it has the focus; return whether it was one of them. */
  key(event) {
    if (event.code !== "Enter" && event.code !== "Space") return false;
    if (event.type === "keyup") this._end();
    else if (!event.repeat) this._start();
    return true;
  }

  _begin(event) {
    this._pointerMs = event.timeStamp;
    if (event.button === 0) this._start();
  }

  _start() {
    if (this.reason !== null) {
      this.use();
      return;
    }
    this._end();
    setAttribute(this.button, "data-holding", "");
    this._timer = setTimeout(() => {
      this._end();
      this.use();
    }, HOLD_MS);
  }

  _end() {
    clearTimeout(this._timer);
    this._timer = null;
    setAttribute(this.button, "data-holding", null);
  }

  /** Assistive technology presses without a pointer and cannot hold: that is deliberate enough. */
  _click(event) {
    if (event.timeStamp - this._pointerMs > 2 * HOLD_MS && event.detail === 0) this.use();
  }
}
