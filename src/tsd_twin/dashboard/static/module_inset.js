// Small panel over the scene with one module enlarged, opened from the Gimbals tab.

import { el, icon, setAttribute } from "./dom.js";
import { ModuleDrawing } from "./module_drawing.js";

const choices = new EventTarget();

/** Enlarge a module. @param {number} index */
export function enlargeModule(index) {
  choices.dispatchEvent(new CustomEvent("module", { detail: index }));
}

export class ModuleInset {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._shown = 0;
    this._drawing = new ModuleDrawing();
    this._choice = el("span.choice", {
      role: "radiogroup",
      "aria-label": "Module",
      onkeydown: (event) => this._key(event),
    });
    const close = el(
      "button.close",
      { type: "button", "aria-label": "Close", onclick: () => this._close() },
      icon("close"),
    );
    this.element = el(
      "section.surface.module-inset",
      { hidden: true, "aria-label": "Module, large" },
      el("div.head", el("span.caption", { "aria-hidden": "true" }, "Module"), this._choice, close),
      this._drawing.element,
    );
    choices.addEventListener("module", (event) =>
      this._open(/** @type {CustomEvent<number>} */ (event).detail),
    );
    link.on("robot", () => this._build());
    link.on("state", () => this._draw());
  }

  _close() {
    this.element.hidden = true;
  }

  _build() {
    const modules = this._link.robot?.modules ?? [];
    if (modules.length === 0) this.element.hidden = true;
    const button = (/** @type {number} */ i) => {
      const onclick = () => this._choose(i);
      const label = { "aria-label": `Module ${i + 1}` };
      return el("button", { type: "button", role: "radio", ...label, onclick }, String(i + 1));
    };
    this._choice.replaceChildren(...modules.map((_, i) => button(i)));
    this._choose(Math.min(this._shown, Math.max(0, modules.length - 1)));
  }

  /** @param {number} index */
  _open(index) {
    this.element.hidden = false;
    this._choose(index);
  }

  /** @param {number} index */
  _choose(index) {
    this._shown = index;
    [...this._choice.children].forEach((choice, i) => {
      setAttribute(choice, "aria-checked", String(i === index));
      setAttribute(choice, "tabindex", i === index ? 0 : -1);
    });
    this._draw();
  }

  _draw() {
    const module = this._link.state?.modules[this._shown];
    if (this.element.hidden || module === undefined) return;
    this._drawing.show(
      {
        tilt_deg: module.tilt,
        lean: module.axle,
        rpm: module.rpm,
        radius_mm: module.radius_mm,
      },
      `Module ${this._shown + 1}`,
    );
  }

  /** @param {KeyboardEvent} event */
  _key(event) {
    /** @type {Record<string, number>} */
    const steps = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
    const step = steps[event.key];
    if (step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const count = this._choice.children.length;
    this._choose((this._shown + step + count) % count);
    /** @type {HTMLElement} */ (this._choice.children[this._shown]).focus();
  }
}
