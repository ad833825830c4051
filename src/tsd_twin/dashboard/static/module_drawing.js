// Large drawing of a drive module: side view with axle, contact and effective radius; top view with
// lean and push, forward up.

import { el, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";

const RADIUS = 34;
const SIDE = 50; // Centre of the wheel in the side and top view.
const ABOVE = 150;
const MIDDLE = 42;
const LEAST_LEAN = 0.005; // Smaller fractions of the tilt limit have no direction.

export class ModuleDrawing {
  constructor() {
    const thin = { "aria-hidden": "true" };
    this._axle = svg("line.axle");
    this._lever = svg("line.lever");
    this._body = svg("path.cap", { d: `M${-RADIUS} 0A${RADIUS} ${RADIUS} 0 0 0 ${RADIUS} 0Z` });
    this._sense = svg("text.sense", { x: 4, y: 7 }); // Next to the axle.
    this._lean = svg("line.axle", { x1: ABOVE, y1: MIDDLE });
    this._end = svg("circle.end", { r: 3 });
    this._push = svg("line.push", { x1: ABOVE, y1: MIDDLE });
    this._tip = svg("path.tip", { d: "M0 -6L4 2H-4Z" });
    this._face = svg(
      "svg.module-drawing",
      { viewBox: "0 0 200 100", role: "img" },
      svg("g", thin, svg("text", { x: 4, y: 97 }, "side"), svg("text", { x: 104, y: 97 }, "above")),
      svg("line.floor", { x1: 6, x2: 94, y1: MIDDLE + RADIUS, y2: MIDDLE + RADIUS }),
      svg("g", { transform: `translate(${SIDE} ${MIDDLE})` }, this._body),
      svg("circle.wheel", { cx: SIDE, cy: MIDDLE, r: RADIUS }),
      ...[this._axle, this._lever, this._sense],
      svg("circle.contact", { cx: SIDE, cy: MIDDLE + RADIUS, r: 3 }),
      svg("circle.wheel", { cx: ABOVE, cy: MIDDLE, r: RADIUS }),
      ...[this._lean, this._end, this._push, this._tip],
      svg("circle.contact", { cx: ABOVE, cy: MIDDLE, r: 3 }),
    );
    this._says = el("p.figures");
    this.element = el("figure.module-figure", this._face, el("figcaption", this._says));
  }

  /** @param {ModuleView} module @param {string} name */
  show({ tilt_deg: tilt, lean, rpm, radius_mm: radius }, name) {
    const angle = (tilt * Math.PI) / 180;
    const [s, c] = [Math.sin(angle), Math.cos(angle)];
    // Side view with the axle leaning to the right, so the push points out of the picture.
    line(this._axle, SIDE - 1.15 * RADIUS * s, MIDDLE + 1.15 * RADIUS * c, [
      SIDE + 1.15 * RADIUS * s,
      MIDDLE - 1.15 * RADIUS * c,
    ]);
    // From the contact to the nearest point on the axle: the effective radius.
    line(this._lever, SIDE, MIDDLE + RADIUS, [SIDE - RADIUS * s * c, MIDDLE + RADIUS * c * c]);
    setAttribute(this._body, "transform", `rotate(${tilt.toFixed(2)})`);
    const [x, y] = lean; // Forward, left.
    const length = Math.hypot(x, y);
    const hasLean = length > LEAST_LEAN;
    setText(this._sense, hasLean ? "⊙ push, towards you" : "no push");
    const end = [ABOVE - RADIUS * y, MIDDLE - RADIUS * x];
    setAttribute(this._lean, "x2", end[0].toFixed(2));
    setAttribute(this._lean, "y2", end[1].toFixed(2));
    setAttribute(this._end, "cx", end[0].toFixed(2));
    setAttribute(this._end, "cy", end[1].toFixed(2));
    // v = r_w spin l x z: the push is 90° to the right of the lean.
    const [ahead, aside] = hasLean ? [y, -x] : [0, 0];
    const tip = [ABOVE - RADIUS * aside, MIDDLE - RADIUS * ahead];
    setAttribute(this._push, "x2", tip[0].toFixed(2));
    setAttribute(this._push, "y2", tip[1].toFixed(2));
    const turned = (-Math.atan2(aside, ahead) * 180) / Math.PI;
    const at = tip.map((place) => place.toFixed(2)).join(" ");
    setAttribute(this._tip, "transform", `translate(${at}) rotate(${turned.toFixed(1)})`);
    setAttribute(this._tip, "visibility", hasLean ? "visible" : "hidden");
    const push = (rpm * Math.PI * radius) / 30_000;
    const says =
      `tilt ${fixed(tilt, 1)}°, contact ${fixed(radius, 2)} mm from the axle, ` +
      `${fixed(rpm, 0)} rpm: push ${fixed(push, 2)} m/s`;
    setText(this._says, says);
    setAttribute(this._face, "aria-label", `${name}: ${says}`);
  }
}

/** @param {Element} node @param {number} x @param {number} y @param {[number, number]} to */
function line(node, x, y, [right, down]) {
  const ends = { x1: x, y1: y, x2: right, y2: down };
  for (const [name, value] of Object.entries(ends)) setAttribute(node, name, value.toFixed(2));
}
