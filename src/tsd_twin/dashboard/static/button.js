// Buttons that show a reason while disabled, and the tooltip.

import { el, setAttribute, setText } from "./dom.js";
import { assertDefined } from "./link.js";

const GAP_PX = 8;
const DELAY_MS = 400;
const HOLD_MS = 1000;
let count = 0;

/** The shared tooltip: describes a control, or why it is disabled. */
class Tooltip {
  constructor() {
    this.element = el("div.tip", { hidden: true, "aria-hidden": "true" });
    this._delay = 0; // Timer until it is shown to a hovering pointer.
    this._refresh = 0; // Timer while it is shown.
  }

  /** @param {HTMLElement} node @param {() => string} text */
  attach(node, text) {
    const show = () => this.show(node, text);
    const hide = () => this._hide();
    node.addEventListener("pointerenter", (event) => {
      clearTimeout(this._delay);
      if (event.pointerType === "mouse") this._delay = setTimeout(show, DELAY_MS);
    });
    for (const end of ["pointerleave", "pointerdown"]) node.addEventListener(end, hide);
    node.addEventListener("focus", () => node.matches(":focus-visible") && show());
    node.addEventListener("blur", hide);
    node.addEventListener("keydown", (event) => event.key === "Escape" && hide());
  }

  /** @param {HTMLElement} node @param {() => string} text */
  show(node, text) {
    this._hide();
    if (!text()) return;
    this.element.hidden = false;
    this._write(node, text());
    this._refresh = setInterval(() => this._write(node, text()), DELAY_MS);
  }

  /** @param {HTMLElement} node @param {string} text */
  _write(node, text) {
    if (text === "") {
      this._hide(); // For example, a button was enabled.
      return;
    }
    setText(this.element, text);
    const frame = assertDefined(this.element.parentElement).getBoundingClientRect();
    const target = node.getBoundingClientRect();
    const own = this.element.getBoundingClientRect();
    const left = target.left + target.width / 2 - own.width / 2 - frame.left;
    const above = target.top - frame.top - own.height - GAP_PX;
    const below = target.bottom - frame.top + GAP_PX;
    const x = Math.max(GAP_PX, Math.min(frame.width - own.width - GAP_PX, left));
    const y = above > GAP_PX ? above : below;
    this.element.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px)`;
  }

  _hide() {
    clearTimeout(this._delay);
    clearInterval(this._refresh);
    this.element.hidden = true;
  }
}

export const tooltip = new Tooltip();

/** @typedef {{ tip?: string, kind?: string }} ButtonOptions */

export class Button {
  /**
   * `press()` is called on use; `tip` describes the action while the button is enabled.
   * @param {string} label @param {() => void} press @param {ButtonOptions} [options]
   */
  constructor(label, press, { tip = "", kind = "" } = {}) {
    /** @type {string | null} */
    this.reason = null;
    this._press = press;
    this._tip = tip;
    const id = `why-${(count += 1)}`;
    this._why = el("span.sr", { id }, tip);
    this._label = el("span.label", label);
    const attributes = { type: "button", class: `button ${kind}`, "aria-describedby": id };
    this.button = el("button", attributes, this._label);
    this.element = el("span.holder", this.button, this._why);
    this.button.addEventListener("click", (event) => this._click(event));
    tooltip.attach(this.button, () => this.reason ?? this._tip);
  }

  /** Change the label and tip. @param {string} label @param {string} tip */
  setLabel(label, tip) {
    setText(this._label, label);
    this._tip = tip;
    this.setDisabledReason(this.reason);
  }

  /** Current label. */
  get label() {
    return this._label.textContent;
  }

  /** Enable the button with null, or disable it with a reason. @param {string | null} reason */
  setDisabledReason(reason) {
    this.reason = reason;
    setAttribute(this.button, "aria-disabled", reason === null ? null : "true");
    setText(this._why, reason ?? this._tip);
  }

  use() {
    if (this.reason !== null) tooltip.show(this.button, () => this.reason ?? "");
    else this._press();
  }

  /** @param {MouseEvent} _event */
  _click(_event) {
    this.use();
  }
}

/** Button that must be held for 1 s, by pointer or key. */
export class LongPressButton extends Button {
  /** @param {string} label @param {() => void} press @param {ButtonOptions} options */
  constructor(label, press, options) {
    super(label, press, { ...options, kind: `hold ${options.kind ?? ""}` });
    this._timer = 0;
    this._isKeyDown = false;
    this._pointerMs = -Infinity;
    this.button.style.setProperty("--hold", `${HOLD_MS}ms`);
    this.button.addEventListener("pointerdown", (event) => this._begin(event));
    for (const end of ["pointerup", "pointercancel", "pointerleave", "blur"])
      this.button.addEventListener(end, () => this._end());
    this.button.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /** Handle a key event; return whether it was for this button. @param {KeyboardEvent} event */
  key(event) {
    if (event.code !== "Enter" && event.code !== "Space") return false;
    this._isKeyDown = event.type === "keydown";
    if (event.type === "keyup") this._end();
    else if (!event.repeat) this._start();
    return true;
  }

  /**
   * Call `then` once no key holds the button; otherwise the key would act on the next focus.
   * @param {() => void} then
   */
  whenReleased(then) {
    const isHeld = this._isKeyDown;
    this._isKeyDown = false;
    if (isHeld) addEventListener("keyup", then, { capture: true, once: true });
    else then();
  }

  /** @param {MouseEvent} event */
  _begin(event) {
    this._pointerMs = event.timeStamp;
    if (event.button === 0) this._start();
  }

  _start() {
    if (this.reason !== null) this.use(); // Show the reason; the hold decides at its end.
    this._end();
    this.button.toggleAttribute("data-holding", true);
    this._timer = setTimeout(() => {
      this._end();
      this.use();
    }, HOLD_MS);
  }

  _end() {
    clearTimeout(this._timer);
    this.button.toggleAttribute("data-holding", false);
  }

  /**
   * Accept activation by assistive technology, which has no pointer and cannot hold.
   * @param {MouseEvent} event
   */
  _click(event) {
    if (event.timeStamp - this._pointerMs > 2 * HOLD_MS && event.detail === 0) this.use();
  }
}
