// Banner and grey veil for a state that is too old: the banner counts the seconds.

import { el, icon, setText } from "./dom.js";
import { duration } from "./format.js";

export class StaleBanner {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this.veil = el("div", { class: "veil", hidden: true });
    this._text = el("strong", { role: "alert" });
    this._count = el("span", { class: "number", "aria-hidden": "true" });
    this._then = el("span", { class: "then" });
    this.banner = el(
      "div",
      { class: "banner", hidden: true },
      icon("fault"),
      this._text,
      this._count,
      this._then,
    );
    for (const type of /** @type {const} */ (["beat", "state", "down"]))
      link.on(type, () => this._draw());
  }

  _draw() {
    const link = this._link;
    const stale = link.isStale();
    this.veil.hidden = !stale;
    this.banner.hidden = !stale;
    if (!stale) return;
    const ageMs = link.ageMs();
    const known = Number.isFinite(ageMs);
    setText(this._text, this._headline(known));
    const seconds = ageMs / 1000;
    setText(
      this._count,
      known ? (seconds < 60 ? `${seconds.toFixed(1)} s` : duration(seconds)) : "",
    );
    setText(this._then, known ? "What you see is old. The robot stops by itself." : "");
  }

  /** @param {boolean} known */
  _headline(known) {
    if (!this._link.connected) return "No connection to the dashboard";
    if (this._link.robot === null) return "Waiting for a robot";
    return known ? "The robot is silent" : "Waiting for the robot";
  }
}
