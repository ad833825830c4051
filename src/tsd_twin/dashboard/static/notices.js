// Transient notices, confirmation dialogs, the stale-state banner and the alarm for unconfirmed
// stops.

import { Button } from "./button.js";
import { el, icon, setText } from "./dom.js";
import { duration } from "./format.js";
import { notConnected } from "./blocked_reasons.js";

const SHOWN_MS = 6000;
const READ_MS = 2000; // Minimum display time of a notice that is no longer true.
const AT_ONCE = 3;

/** @typedef {{ key: string, untilMs: number, readMs: number, isTrue: () => boolean }} Shown */

export class Notices {
  /** @param {Link} link */
  constructor(link) {
    /** @type {Map<Element, Shown>} */
    this._shown = new Map();
    this._list = el("div.toasts", { role: "log", "aria-live": "polite", "aria-label": "Messages" });
    this._question = el("div.question");
    this.element = el("div.notices", this._question, this._list);
    let robot = link.robot?.id;
    link.on(["beat", "state"], () => this._tidy());
    link.on("robot", ({ id }) => {
      const isOther = robot !== undefined && id !== robot; // Notices of the previous robot.
      if (isOther) for (const toast of [...this._shown.keys()]) this._remove(toast);
      robot = id;
    });
  }

  /** Whether a question is open. */
  get asks() {
    return this._question.childElementCount > 0;
  }

  /**
   * Show a notice while it is true; repeating the same one only extends it.
   * @param {string} text @param {() => boolean} [isTrue] @param {string} [key] Identifies it.
   */
  say(text, isTrue = () => true, key = text) {
    const nowMs = performance.now();
    const same = [...this._shown].find(([, shown]) => shown.key === key)?.[0];
    const toast = same ?? el("div.toast.surface", text);
    this._shown.set(toast, { key, untilMs: nowMs + SHOWN_MS, readMs: nowMs + READ_MS, isTrue });
    if (same) {
      setText(same, text); // Its numbers may have changed.
      return;
    }
    for (const oldest of [...this._shown.keys()].slice(0, -AT_ONCE)) this._remove(oldest);
    this._list.append(toast);
  }

  /** Remove notices that expired or are no longer true. */
  _tidy() {
    const nowMs = performance.now();
    for (const [toast, { untilMs, readMs, isTrue }] of [...this._shown])
      if (nowMs > untilMs || (nowMs > readMs && !isTrue())) this._remove(toast);
  }

  /** @param {Element} toast */
  _remove(toast) {
    this._shown.delete(toast);
    toast.remove();
  }

  /** Dismiss the question. */
  dismissPrompt() {
    this._question.replaceChildren();
  }

  /**
   * Ask for confirmation and a text passed to `yes`; replaces an open question.
   * @param {string} text @param {string} label @param {string} field Label of the word.
   * @param {(word: string) => void} yes
   */
  ask(text, label, field, yes) {
    const done = () => this.dismissPrompt();
    const onkeydown = (/** @type {KeyboardEvent} */ { key }) => key === "Enter" && agree.use();
    const entry = el("input", { type: "text", maxlength: 120, onkeydown });
    const press = () => (done(), yes(entry.value.trim()));
    const agree = new Button(label, press, { kind: "primary" });
    const refuse = new Button("Cancel", done, { kind: "quiet" });
    const dialog = el(
      "div.dialog.surface",
      { role: "alertdialog", "aria-label": label },
      { onkeydown: ({ key }) => key === "Escape" && done() },
      el("p", text),
      el("label.field", field, entry),
      el("div.row", refuse.element, agree.element),
    );
    this._question.replaceChildren(dialog);
    refuse.button.focus({ focusVisible: false });
  }
}

/** Alarm for an unconfirmed stop, shown until confirmed or acknowledged. */
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

/** Banner and grey veil over a stale state; the banner counts the seconds. */
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
    document.documentElement.toggleAttribute("data-tsd-silent", stale);
    this.veil.hidden = !stale;
    this.banner.hidden = !stale;
    if (!stale) return;
    this.banner.toggleAttribute("data-waits", link.isLoading());
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
    if (!this._link.connected) return notConnected(this._link);
    if (this._link.robot === null) return "Waiting for a robot";
    return isShown ? "The robot is silent" : "Waiting for the robot";
  }
}
