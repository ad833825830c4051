// Page settings at the end of the View tab: operator name, key sheet and first steps.

import { el, setAttribute, setText } from "./dom.js";
import { keepName } from "./operator_name.js";

export class PageSettings {
  /**
   * @param {Link} link @param {ShadowRoot} place @param {AbortSignal} signal
   * @param {Guides} guides
   */
  constructor(link, place, signal, { keySheet, firstSteps }) {
    this._link = link;
    this._name = el("input", { type: "text", maxlength: 40, autocomplete: "nickname" });
    this._name.value = link.name;
    this._note = el("p.muted", { id: "name-note" });
    this._name.setAttribute("aria-describedby", "name-note");
    this._name.addEventListener("change", () => this._take());
    this._field = el("div.field", el("label", "Your name", this._name), this._note);
    const button = (/** @type {string} */ name, /** @type {() => void} */ onclick) =>
      el("button.button", { type: "button", onclick }, name);
    const keys = button("Keys and colours", () => keySheet.toggle());
    const steps = button("First steps", () => firstSteps.open());
    place.append(el("section.settings", { "aria-label": "This page" }, this._field, keys, steps));
    link.on(["welcome", "state", "down"], () => this._show(), signal);
    this._show();
  }

  _take() {
    this._name.value = keepName(this._name.value);
    this._link.rename(this._name.value);
  }

  _show() {
    const drives = this._link.state?.has_control ?? false;
    // With logins, the login name is used.
    this._field.hidden = (this._link.welcome?.user ?? null) !== null;
    this._name.readOnly = drives;
    setAttribute(this._name, "aria-disabled", drives ? "true" : null);
    const note = drives ? "Release control to change it." : "Other operators see it.";
    setText(this._note, note);
  }
}
