// A sphere that wheels turn in place: how it is turned, and what the two models of its contacts say.

import { el, isVisible, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";
import { known } from "./link.js";
import { notDrive } from "./permission.js";
import { rotated } from "./twist_mapping.js";
import { EstimateDifference, WheelList } from "./wheels.js";

const RADIUS = 40; // Of the drawing.
/** @type {[string, Triple, string][]} */
const ENDS = [
  ["front", [1, 0, 0], "front"],
  ["plain", [-1, 0, 0], "back"],
  ["plain", [0, 1, 0], "left"],
  ["plain", [0, -1, 0], "right"],
  ["up", [0, 0, 1], "top"],
  ["plain", [0, 0, -1], "bottom"],
];
const ROWS = ["–", "first", "second"];

export class Sphere {
  /** @param {Link} link @param {HTMLElement} place @param {SphereGoTo} sphereGoTo */
  constructor(link, place, sphereGoTo) {
    this._link = link;
    this._marks = ENDS.map(([name]) => svg("circle", { class: name, r: 5 }));
    const globe = svg(
      "svg",
      {
        class: "globe",
        viewBox: "-50 -50 100 100",
        role: "img",
        "aria-label": "The sphere from above, forward up, with the marks that it has",
      },
      svg("circle", { class: "limit", r: RADIUS }),
      svg("path", { class: "cross", d: `M0 ${-RADIUS}V${RADIUS}M${-RADIUS} 0H${RADIUS}` }),
      ...this._marks,
    );
    /** @type {Record<string, Element[]>} */
    this._cells = {};
    const table = el(
      "table",
      { class: "models", "aria-label": "Angular velocity by the two models, rad/s" },
      el(
        "thead",
        {},
        el("tr", {}, ...["rad/s", "ideal", "dual"].map((name) => el("th", { scope: "col" }, name))),
      ),
      el("tbody", {}, ...["ωx", "ωy", "ωz"].map((name) => this._line(name))),
    );
    this._bring = ENDS.map(([, at, name]) =>
      el("button", { type: "button", onclick: () => sphereGoTo.bring(at) }, name),
    );
    this._between = el("p", { class: "verdict" });
    this._rows = el("p", { class: "verdict" });
    this._list = new WheelList(link);
    this._apart = new EstimateDifference(link);
    place.append(
      el("div", { class: "sphere" }, globe, table),
      this._between,
      this._rows,
      this._apart.element,
      this._list.element,
      el(
        "p",
        { class: "verdict" },
        "Click on the sphere to bring that point up, or choose a mark:",
      ),
      el("div", { class: "bring", role: "group", "aria-label": "Bring up" }, ...this._bring),
    );
    this._open = true;
    link.on("state", () => this._open && isVisible(place) && this._show());
  }

  close() {
    this._open = false;
  }

  /** @param {string} name */
  _line(name) {
    const cells = ["ideal", "dual"].map(() => el("td", { class: "value" }));
    this._cells[name] = cells;
    return el("tr", {}, el("th", { scope: "row" }, name), ...cells);
  }

  _show() {
    this._list.show(null);
    this._apart.show();
    const refused = notDrive(this._link) === null ? null : "true";
    for (const button of this._bring) setAttribute(button, "aria-disabled", refused);
    const { ball } = known(this._link.state);
    if (ball === null) return;
    this._marks.forEach((node, i) => put(node, rotated(ball.wxyz, ENDS[i][1])));
    ["ωx", "ωy", "ωz"].forEach((name, i) => {
      setText(this._cells[name][0], fixed(ball.ideal[i], 2));
      setText(this._cells[name][1], fixed(ball.dual?.[i], 2));
    });
    setText(
      this._between,
      `The two differ by ${fixed(ball.angle_deg, 2)}° in direction, ` +
        `${fixed(ball.magnitude_percent, 2)} % in size.`,
    );
    setText(this._rows, `Rows in contact: ${ball.rows.map((row) => ROWS[row]).join(", ")}.`);
  }
}

/**
 * Seen from above, x up and y to the left; what is below is faint.
 * @param {Element} node
 * @param {Triple} point
 */
function put(node, [x, y, z]) {
  setAttribute(node, "cx", (-y * RADIUS).toFixed(2));
  setAttribute(node, "cy", (-x * RADIUS).toFixed(2));
  setAttribute(node, "data-below", z < 0 ? "" : null);
}
