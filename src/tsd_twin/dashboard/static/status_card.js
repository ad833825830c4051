// Status card: arming progress, reason for a stop or fault, and reset.

import { LongPressButton } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";
import { clock, duration } from "./format.js";
import { resetBlockedReason, showsRecording } from "./blocked_reasons.js";
import { stopReason } from "./reasons.js";

/** @type {Record<string, string>} */
const PHASES = {
  neutral: "Bringing the gimbals to neutral tilt",
  hold: "Speed controllers at zero throttle",
  spin_up: "Spinning the wheels up",
};
/** @type {Record<string, string>} */
const TITLES = { arming: "Arming", stopped: "Stopped", fault: "Fault" };

export class StatusCard {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    /** @type {() => void} */
    this.onReset = () => {}; // Called when the card had focus and disappears.
    this._mode = null;
    this._shape = el("span.shape");
    this._title = el("h2");
    this._text = el("p.why", { "aria-live": "polite" });
    this._since = el("p.since.number");
    this._hold = el("div");
    this._spinUp = el("div");
    this._bar = el(
      "div.progress",
      { role: "progressbar", "aria-label": "Arming", "aria-valuemin": "0", "aria-valuemax": "100" },
      this._hold,
      this._spinUp,
    );
    this._next = el("p.next");
    this.reset = new LongPressButton("Reset stop", () => link.send({ t: "reset" }), {
      tip: "Hold for one second. The robot does not move; arm it next.",
      kind: "primary",
    });
    this._action = el("div.action", this.reset.element, this._next);
    this.element = el(
      "section.card.surface",
      { hidden: true },
      el("div.head", this._shape, this._title, this._since),
      this._text,
      this._bar,
      this._action,
    );
    link.on(["state", "beat", "down"], () => this._draw());
  }

  /** Whether a stop can be reset now, so that keys on the button belong to it. */
  get latched() {
    return this._mode === "stopped" || this._mode === "fault";
  }

  _draw() {
    const state = this._link.state;
    const mode = state === null || this._link.isStale() ? null : state.status.mode;
    this._mode = mode;
    const hadFocus = this.element.contains(activeIn(this.element));
    this.element.hidden = mode === null || !(mode in TITLES);
    if (this.element.hidden && hadFocus && mode !== null) this.reset.whenReleased(this.onReset);
    if (state === null || mode === null || this.element.hidden) return;
    if (this.element.dataset.mode !== mode) {
      this.element.dataset.mode = mode;
      this._shape.replaceChildren(icon(mode));
    }
    const recorded = showsRecording(this._link) ? "Recording: " : "";
    setText(this._title, `${recorded}${TITLES[mode]}`);
    this._bar.hidden = mode !== "arming";
    this._action.hidden = mode === "arming";
    const sinceMs = Date.now() - 1000 * state.mode_age_s;
    const since = `since ${clock(sinceMs)}, ${duration(state.mode_age_s)}`;
    setText(this._since, mode === "arming" ? "" : since);
    if (mode === "arming") this._drawArming(state.status.arming);
    else this._drawLatched(state.status);
  }

  /** @param {ArmingStatus | null} arming */
  _drawArming(arming) {
    const [phase, progress] = [arming?.phase ?? "hold", arming?.progress ?? 0];
    setText(this._text, `${PHASES[phase] ?? "Working"}.`);
    const [hold, spinUp] = phase === "spin_up" ? [1, progress] : [progress, 0];
    this._hold.style.setProperty("--done", String(hold));
    this._spinUp.style.setProperty("--done", String(spinUp));
    setAttribute(this._bar, "aria-valuenow", Math.round(50 * (hold + spinUp)));
  }

  /** @param {Status} status */
  _drawLatched(status) {
    setText(this._text, stopReason(status.stop, this._link.welcome?.operator));
    const refusal = resetBlockedReason(this._link);
    this.reset.setDisabledReason(refusal);
    setText(this._next, refusal ?? "Hold for one second, then arm.");
  }
}

/** Return the focused element in the root of `node`. @param {HTMLElement} node */
function activeIn(node) {
  return /** @type {Document | ShadowRoot} */ (node.getRootNode()).activeElement;
}
