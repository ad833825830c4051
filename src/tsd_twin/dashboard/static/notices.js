// Transient notices, and confirmation dialogs.

import { Button } from "./button.js";
import { el } from "./dom.js";

const SHOWN_MS = 6000;
const AT_ONCE = 3;

export class Notices {
  /** @param {Tooltip} tips */
  constructor(tips) {
    this._tips = tips;
    /** @type {WeakMap<Element, number>} */
    this._timers = new WeakMap();
    this._list = el("div", {
      class: "toasts",
      role: "log",
      "aria-live": "polite",
      "aria-label": "Messages",
    });
    this._question = el("div", { class: "question" });
    this.element = el("div", { class: "notices" }, this._question, this._list);
  }

  /**
   * Say something; the same sentence again only stays longer.
   * @param {string} text
   */
  say(text) {
    const same = [...this._list.children].find((child) => child.textContent === text);
    const toast = same ?? el("div", { class: "toast surface" }, text);
    clearTimeout(this._timers.get(toast));
    this._timers.set(
      toast,
      setTimeout(() => toast.remove(), SHOWN_MS),
    );
    if (same) return;
    while (this._list.childElementCount >= AT_ONCE) this._list.firstElementChild?.remove();
    this._list.append(toast);
  }

  /**
   * Ask; `yes(word)` is called if it is agreed to, with what stands in the `field`, if there is one.
   * A new question takes the place of the old one.
   * @param {string} text
   * @param {string} label
   * @param {(word: string | undefined) => void} yes
   * @param {{ label: string, value: string } | null} field
   */
  ask(text, label, yes, field = null) {
    const done = () => this._question.replaceChildren();
    const entry =
      field === null ? null : el("input", { type: "text", maxlength: "120", value: field.value });
    entry?.addEventListener("keydown", (event) => event.key === "Enter" && agree.use());
    const agree = new Button(label, {
      tips: this._tips,
      press: () => (done(), yes(entry?.value.trim())),
      kind: "primary",
    });
    const refuse = new Button("Cancel", { tips: this._tips, press: done, kind: "quiet" });
    const dialog = el(
      "div",
      {
        class: "dialog surface",
        role: "alertdialog",
        "aria-label": label,
        onkeydown: (event) => event.key === "Escape" && done(),
      },
      el("p", {}, text),
      entry === null ? null : el("label", { class: "field" }, field?.label ?? "", entry),
      el("div", { class: "row" }, refuse.element, agree.element),
    );
    this._question.replaceChildren(dialog);
    refuse.button.focus({ focusVisible: false });
  }
}

/**
 * What of a robot's events is worth a sentence; the rest stands in the log of the Health tab.
 * @param {RobotEvent} event
 * @param {string | undefined} operator
 */
export function isNotable({ kind, text }, operator) {
  if (kind === "id" || kind === "description") return true;
  if (kind === "lease" && text.includes(` asks ${operator} `)) return false; // A notice says it.
  if (kind === "lease")
    return operator === undefined || !text.startsWith(operator) || text.includes(" took ");
  return (
    kind === "mode" && /to (stopping|disarmed):/.test(text) && !text.includes("by the operator")
  );
}
