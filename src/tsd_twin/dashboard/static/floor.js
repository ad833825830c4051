// The floor under a finger: a layer over the scene, below all controls, that takes a click or a
// stroke and shows it until the way that is made of it is seen.

import { el, svg } from "./dom.js";

const STEP_PX = 5;
const MOST_POINTS = 200; // A message has room for a few more.
const SHOWN_MS = 600;

export class FloorLayer {
  /** `take(points)` gets shares of the picture, right and down. */
  constructor(take) {
    this._take = take;
    this._mode = null;
    this._pointer = null;
    this._points = [];
    this._line = svg("polyline", { class: "stroke" });
    this._dot = svg("circle", { class: "goal", r: 7 });
    this.element = el(
      "div",
      { class: "floor", hidden: true, "aria-hidden": "true" },
      svg("svg", {}, this._line, this._dot),
    );
    const on = (type, listener) => this.element.addEventListener(type, listener);
    on("pointerdown", (event) => this._begin(event));
    on("pointermove", (event) => this._move(event));
    on("pointerup", (event) => this._finish(event));
    for (const end of ["pointercancel", "lostpointercapture"])
      on(end, (event) => event.pointerId === this._pointer && this._clear());
    on("contextmenu", (event) => event.preventDefault());
  }

  /** Take clicks (`to`), strokes (`draw`), or nothing: then the scene has them. */
  open(mode) {
    this._mode = mode;
    this.element.hidden = mode === null;
    this._clear();
  }

  /** While the robot goes, the scene has the clicks. */
  rest(going) {
    this.element.style.pointerEvents = going ? "none" : "";
  }

  _begin(event) {
    if (this._pointer !== null || event.button !== 0) return;
    event.preventDefault();
    clearTimeout(this._timer);
    this._pointer = event.pointerId;
    this.element.setPointerCapture(event.pointerId);
    this._points = [this._place(event)];
    this._draw();
  }

  _move(event) {
    if (event.pointerId !== this._pointer) return;
    const here = this._place(event);
    const [x, y] = this._points.at(-1);
    if (Math.hypot(here[0] - x, here[1] - y) < STEP_PX && this._points.length > 1) return;
    if (this._mode === "to") this._points.length = 1;
    this._points.push(here);
    this._draw();
  }

  _finish(event) {
    if (event.pointerId !== this._pointer) return;
    this._pointer = null;
    const { width, height } = this.element.getBoundingClientRect();
    const points = thinned(this._points).map(([x, y]) => [share(x / width), share(y / height)]);
    this._take(points);
    this._timer = setTimeout(() => this._clear(), SHOWN_MS);
  }

  _clear() {
    this._pointer = null;
    this._points = [];
    this._draw();
  }

  _place(event) {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  _draw() {
    this._line.setAttribute("points", this._points.map((point) => point.join()).join(" "));
    const at = this._mode === "to" ? this._points[0] : this._points.at(-1);
    this._dot.setAttribute("visibility", at ? "visible" : "hidden");
    if (!at) return;
    this._dot.setAttribute("cx", at[0]);
    this._dot.setAttribute("cy", at[1]);
  }
}

/** Return every second point, again and again until they are few; ends stay. */
function thinned(points) {
  while (points.length > MOST_POINTS)
    points = points.filter((_, i) => i % 2 === 0 || i === points.length - 1);
  return points;
}

function share(value) {
  return Number(Math.max(0, Math.min(1, value)).toFixed(5));
}
