// Status card: progress of arming, reason of a stop or fault, and the reset.

import { LongPressButton } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";
import { clock, duration } from "./format.js";
import { notReset } from "./permission.js";

const PHASES = ["neutral", "hold", "spin_up"];
const DOING = {
  neutral: "Bringing the gimbals to neutral tilt",
  hold: "Speed controllers at zero throttle",
  spin_up: "Spinning the wheels up",
};
const TITLES = { arming: "Arming", stopped: "Stopped", fault: "Fault" };

export class StatusCard {
  constructor(link, tips) {
    this._link = link;
    this._shape = el("span", { class: "shape" });
    this._title = el("h2");
    this._text = el("p", { class: "why", "aria-live": "polite" });
    this._since = el("p", { class: "since number" });
    this._bar = el(
      "div",
      {
        class: "progress",
        role: "progressbar",
        "aria-label": "Arming",
        "aria-valuemin": "0",
        "aria-valuemax": "100",
      },
      el("div"),
      el("div"),
    );
    this._next = el("p", { class: "next" });
    this.reset = new LongPressButton("Reset stop", {
      tips,
      press: () => link.send({ t: "reset" }),
      tip: "Hold for one second. It leads to disarmed, never to motion.",
      kind: "primary",
    });
    this._action = el("div", { class: "action" }, this.reset.element, this._next);
    this.element = el(
      "section",
      { class: "card surface", hidden: true },
      el("div", { class: "head" }, this._shape, this._title, this._since),
      this._text,
      this._bar,
      this._action,
    );
    for (const type of ["state", "beat", "down"]) link.on(type, () => this._draw());
  }

  /** Whether the stop can be reset now, so that keys on the button belong to it. */
  get latched() {
    return ["stopped", "fault"].includes(this._mode);
  }

  _draw() {
    const state = this._link.state;
    this._mode = state === null || this._link.isStale() ? null : state.status.mode;
    const shown = this._mode in TITLES;
    this.element.hidden = !shown;
    if (!shown) return;
    if (this.element.dataset.mode !== this._mode) {
      this.element.dataset.mode = this._mode;
      this._shape.replaceChildren(icon(this._mode));
      setText(this._title, TITLES[this._mode]);
    }
    this._bar.hidden = this._mode !== "arming";
    this._action.hidden = this._mode === "arming";
    const sinceMs = Date.now() - 1000 * state.mode_age_s;
    setText(
      this._since,
      this._mode === "arming" ? "" : `since ${clock(sinceMs)}, ${duration(state.mode_age_s)}`,
    );
    if (this._mode === "arming") this._drawArming(state.status.arming);
    else this._drawLatched(state.status);
  }

  _drawArming(arming) {
    const phase = PHASES.indexOf(arming?.phase ?? "hold");
    const progress = arming?.progress ?? 0;
    setText(this._text, `${DOING[PHASES[phase]] ?? "Working"}.`);
    const [hold, spin] = this._bar.children;
    hold.style.setProperty("--done", phase > 1 ? 1 : progress);
    spin.style.setProperty("--done", phase > 1 ? progress : 0);
    setAttribute(
      this._bar,
      "aria-valuenow",
      Math.round(100 * (phase > 1 ? 0.5 + progress / 2 : progress / 2)),
    );
  }

  _drawLatched(status) {
    const reason = status.stop_reason || "no reason given";
    setText(this._text, `${reason[0].toUpperCase()}${reason.slice(1)}.`);
    const refusal = notReset(this._link);
    this.reset.allow(refusal);
    setText(this._next, refusal ?? "Hold for one second, then arm.");
  }
}
