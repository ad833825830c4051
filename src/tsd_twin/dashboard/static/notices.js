// Transient notices, confirmation dialogs, the banner of a state that is too old, and the alarm of a
// stop that is not confirmed.

import { Button } from "./button.js";
import { el, icon, setText } from "./dom.js";
import { duration } from "./format.js";

const SHOWN_MS = 6000;
const AT_ONCE = 3;

export class Notices {
  constructor() {
    /** @type {WeakMap<Element, number>} */
    this._timers = new WeakMap();
    this._list = el("div.toasts", { role: "log", "aria-live": "polite", "aria-label": "Messages" });
    this._question = el("div.question");
    this.element = el("div.notices", this._question, this._list);
  }

  /** Say something; the same sentence again only stays longer. @param {string} text */
  say(text) {
    const same = [...this._list.children].find((child) => child.textContent === text);
    const toast = same ?? el("div.toast.surface", text);
    clearTimeout(this._timers.get(toast));
    const timer = setTimeout(() => toast.remove(), SHOWN_MS);
    this._timers.set(toast, timer);
    if (same) return;
    while (this._list.childElementCount >= AT_ONCE) this._list.firstElementChild?.remove();
    this._list.append(toast);
  }

  /**
   * Ask for a yes, and a word for `yes`; a new question takes the place of the old one.
   * @param {string} text @param {string} label @param {{ label: string, value: string }} field
   * @param {(word: string) => void} yes
   */
  ask(text, label, field, yes) {
    const done = () => this._question.replaceChildren();
    const onkeydown = (/** @type {KeyboardEvent} */ { key }) => key === "Enter" && agree.use();
    const entry = el("input", { type: "text", maxlength: 120, value: field.value, onkeydown });
    const press = () => (done(), yes(entry.value.trim()));
    const agree = new Button(label, press, { kind: "primary" });
    const refuse = new Button("Cancel", done, { kind: "quiet" });
    const dialog = el(
      "div.dialog.surface",
      { role: "alertdialog", "aria-label": label },
      { onkeydown: ({ key }) => key === "Escape" && done() },
      el("p", text),
      el("label.field", field.label, entry),
      el("div.row", refuse.element, agree.element),
    );
    this._question.replaceChildren(dialog);
    refuse.button.focus({ focusVisible: false });
  }
}

/**
 * What of a robot's events is worth a sentence; the rest stands in the log of the Health tab.
 * @param {RobotEvent} event @param {string | undefined} operator
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

/** Alarm of a stop that the robot has not confirmed: until it does, or until it is acknowledged. */
export class StopAlarm {
  /** @param {Drive} drive */
  constructor(drive) {
    this._text = el("strong", { role: "alert" });
    const seen = new Button("Acknowledge", () => drive.acknowledgeStop(), {
      tip: "Close this notice; the robot may still move",
    });
    this.element = el(
      "div.banner.alarm",
      { hidden: true },
      icon("fault"),
      this._text,
      seen.element,
    );
    drive.onChange(() => {
      this.element.hidden = !drive.stopUnconfirmed;
      const text = drive.stopUnconfirmed ? "STOP NOT CONFIRMED. Press the hardware stop." : "";
      setText(this._text, text);
    });
  }
}

/** Banner and grey veil over a state that is too old: the banner counts the seconds. */
export class StaleBanner {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this.veil = el("div.veil", { hidden: true });
    this._text = el("strong", { role: "alert" });
    this._count = el("span.number", { "aria-hidden": "true" });
    this._then = el("span.then");
    const content = [icon("fault"), this._text, this._count, this._then];
    this.banner = el("div.banner", { hidden: true }, ...content);
    link.on(["beat", "state", "down"], () => this._draw());
  }

  _draw() {
    const link = this._link;
    const stale = link.isStale();
    this.veil.hidden = !stale;
    this.banner.hidden = !stale;
    if (!stale) return;
    const ageMs = link.ageMs();
    const isShown = Number.isFinite(ageMs);
    setText(this._text, this._headline(isShown));
    const seconds = ageMs / 1000;
    const age = seconds < 60 ? `${seconds.toFixed(1)} s` : duration(seconds);
    setText(this._count, isShown ? age : "");
    setText(this._then, isShown ? "What you see is old. The robot stops by itself." : "");
  }

  /** @param {boolean} isShown */
  _headline(isShown) {
    if (!this._link.connected) return "No connection to the dashboard";
    if (this._link.robot === null) return "Waiting for a robot";
    return isShown ? "The robot is silent" : "Waiting for the robot";
  }
}
