// Readout of the estimated pose and speed.

import { el, setText } from "./dom.js";
import { kindOf } from "./kinds.js";

export class PoseReadout {
  /** @param {Link} link @param {HTMLElement} button Map button, placed at the end. */
  constructor(link, button) {
    this._link = link;
    this._button = button;
    this._readings = null;
    /** @type {[Element, Reading[2]][]} */
    this._cells = [];
    this.element = el("div.pose.surface");
    link.on(["beat", "robot", "down"], () => this._draw()); // Beats are half as frequent as states.
    this._draw();
  }

  _draw() {
    const { readings } = kindOf(this._link.robot);
    if (readings !== this._readings) this._build(readings);
    const { state } = this._link;
    const stale = this._link.isStale();
    this.element.toggleAttribute("data-stale", stale);
    // The last position remains useful, but the speed is unknown.
    const shown = stale ? { pose: state?.pose, sphere: state?.sphere } : (state ?? {});
    for (const [value, read] of this._cells) setText(value, read(shown));
  }

  /** @param {Kind["readings"]} readings */
  _build(readings) {
    this._readings = readings;
    this._cells = [];
    const groups = Object.entries(readings).map(([label, figures]) =>
      el(
        "span.figures",
        { role: "status", "aria-live": "off", "aria-label": label },
        ...figures.map((reading) => this._figure(...reading)),
      ),
    );
    this.element.replaceChildren(...groups, this._button);
  }

  /** @param {string} name @param {string} unit @param {Reading[2]} read */
  _figure(name, unit, read) {
    const value = el("span.value.number");
    this._cells.push([value, read]);
    const shownUnit = el("span.unit", unit === "°" ? unit : ` ${unit}`);
    return el("span.figure", el("span.name", name), " ", value, shownUnit, " ");
  }
}
