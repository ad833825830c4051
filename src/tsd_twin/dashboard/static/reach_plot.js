// Outlines of reachable twists in two components: the first is up, the second left.

import { el, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";

const REACH = 40; // Length of an axis, relative to half the width of the drawing.

export class ReachPlot {
  constructor() {
    this._shadow = svg("path.shadow");
    this._section = svg("path.section");
    this._dot = svg("circle.dot", { r: 3 });
    this._up = svg("text.axis", { x: 3, y: -REACH - 4 });
    this._left = svg("text.axis", { x: -REACH - 8, y: -4 });
    this._face = svg(
      "svg.reach",
      { viewBox: "-54 -54 108 108", role: "img" },
      svg("path.cross", { d: `M0 ${-REACH}V${REACH}M${-REACH} 0H${REACH}` }),
      ...[this._shadow, this._section, this._dot, this._up, this._left],
    );
    this._caption = el("figcaption.muted");
    this.element = el("figure", this._face, this._caption);
  }

  /** @param {StudentOutline} outline @param {StudentFigures} figures */
  show({ axes: [first, second], section, shadow }, { axes, tops, twist }) {
    const [up, left] = [axes[first], axes[second]];
    // Speeds share a scale; a turn rate has a separate one.
    const largest = Math.max(...shadow.map(([a]) => Math.abs(a)));
    const widest = Math.max(...shadow.map(([, b]) => Math.abs(b)));
    const together = Math.max(largest, widest);
    const [scaleUp, scaleLeft] = up.unit === left.unit ? [together, together] : [largest, widest];
    const point = (/** @type {[number, number]} */ [a, b]) =>
      [(-b / scaleLeft) * REACH, (-a / scaleUp) * REACH].map((x) => x.toFixed(2)).join(" ");
    const outline = (/** @type {[number, number][]} */ points) =>
      `M${points.map(point).join("L")}Z`;
    setAttribute(this._shadow, "d", outline(shadow));
    setAttribute(this._section, "d", outline(section));
    const [x, y] = point([twist[first], twist[second]]).split(" ");
    setAttribute(this._dot, "cx", x);
    setAttribute(this._dot, "cy", y);
    setText(this._up, up.symbol);
    setText(this._left, left.symbol);
    const said =
      `${up.symbol} to ${fixed(tops[first], 2)} ${up.unit}, ` +
      `${left.symbol} to ${fixed(tops[second], 2)} ${left.unit}`;
    setText(this._caption, said);
    setAttribute(this._face, "aria-label", `Reachable twists: ${said}`);
  }
}
