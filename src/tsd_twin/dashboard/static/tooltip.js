// The one tooltip: what a control does, or why it cannot be used now.

import { el, setText } from "./dom.js";

const GAP_PX = 8;
const DELAY_MS = 400;

export class Tooltip {
  constructor() {
    this.element = el("div", { class: "tip", hidden: true, "aria-hidden": "true" });
    this._node = null;
    this._timer = null;
  }

  /** Show `text()` while the pointer or the focus is on a node. */
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

  /** Show `text()` beside a node, within the overlay, and keep it true. */
  show(node, text) {
    this._hide();
    if (!text()) return;
    this._node = node;
    this.element.hidden = false;
    this._write(text);
    this._timer = setInterval(() => this._write(text), DELAY_MS);
  }

  _write(text) {
    setText(this.element, text());
    const frame = this.element.parentElement.getBoundingClientRect();
    const target = this._node.getBoundingClientRect();
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
