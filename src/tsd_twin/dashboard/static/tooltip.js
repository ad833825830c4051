// The one tooltip: what a control does, or why it cannot be used now.

import { el, setText } from "./dom.js";
import { known } from "./link.js";

const GAP_PX = 8;
const DELAY_MS = 400;

export class Tooltip {
  constructor() {
    this.element = el("div", { class: "tip", hidden: true, "aria-hidden": "true" });
    /** @type {Element | null} */
    this._node = null;
    /** @type {number | undefined} */
    this._timer = undefined;
  }

  /**
   * Show `text()` while the pointer or the focus is on a node.
   * @param {HTMLElement} node
   * @param {() => string} text
   */
  attach(node, text) {
    const show = () => this.show(node, text);
    const hide = () => this._hide();
    node.addEventListener("pointerenter", (event) => {
      if (event.pointerType === "mouse") this._timer = setTimeout(show, DELAY_MS);
    });
    for (const end of ["pointerleave", "pointerdown"]) node.addEventListener(end, hide);
    node.addEventListener("focus", () => node.matches(":focus-visible") && show());
    node.addEventListener("blur", hide);
    node.addEventListener("keydown", (event) => event.key === "Escape" && hide());
  }

  /**
   * Show `text()` beside a node, within the overlay, and keep it true.
   * @param {HTMLElement} node
   * @param {() => string} text
   */
  show(node, text) {
    this._hide();
    if (!text()) return;
    this._node = node;
    this.element.hidden = false;
    this._write(text);
    this._timer = setInterval(() => this._write(text), DELAY_MS);
  }

  /** @param {() => string} text */
  _write(text) {
    setText(this.element, text());
    const frame = known(this.element.parentElement).getBoundingClientRect();
    const target = known(this._node).getBoundingClientRect();
    const own = this.element.getBoundingClientRect();
    const left = target.left + target.width / 2 - own.width / 2 - frame.left;
    const above = target.top - frame.top - own.height - GAP_PX;
    const below = target.bottom - frame.top + GAP_PX;
    const x = Math.max(GAP_PX, Math.min(frame.width - own.width - GAP_PX, left));
    this.element.style.transform = `translate(${Math.round(x)}px, ${Math.round(above > GAP_PX ? above : below)}px)`;
  }

  _hide() {
    clearInterval(this._timer); // The same as clearTimeout.
    this.element.hidden = true;
  }
}
