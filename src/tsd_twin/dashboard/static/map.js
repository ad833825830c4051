// Map: top view with all robots, their trails, planned paths and the stop envelope. A click on the
// map plans a path with the same request as a click in the scene, and nothing moves.

import { tooltip } from "./button.js";
import { el, icon, isVisible, setAttribute } from "./dom.js";
import { PointerCapture } from "./held_controls.js";
import { kindOf } from "./kinds.js";
import { drawMap } from "./map_drawing.js";
import { MapTrails, MapView } from "./map_view.js";
import { keep, recall } from "./memory.js";
import { planBlockedReason } from "./blocked_reasons.js";
import { MIN_STEP_PX, thinned } from "./waypoints.js";

const KEY = "tsd.map";
const STROKE_SHOWN_MS = 600; // Until the planned path is visible.
const DENSEST = 2;

export class FloorMap {
  /** @param {Link} link @param {Waypoints} waypoints */
  constructor(link, waypoints) {
    this._link = link;
    this._waypoints = waypoints;
    this._view = new MapView();
    this._trails = new MapTrails();
    /** @type {Record<string, FloorPoint[]>} */
    this._routes = {};
    /** @type {[number, number][]} */
    this._stroke = [];
    this._timer = 0;
    this._isOpen = false;
    this.button = el(
      "button.button.quiet.map-button",
      { type: "button", "aria-pressed": "false", onclick: () => this.toggle() },
      "Map",
    );
    this._canvas = el("canvas", { role: "img", "aria-label": "Map" });
    this._ink = el("i.ink", { hidden: true });
    this._line = el("i.line", { hidden: true });
    const tool = (
      /** @type {string} */ name,
      /** @type {string} */ shape,
      /** @type {() => void} */ onclick,
    ) =>
      el(
        `button.button.quiet.${shape}`,
        { type: "button", "aria-label": name, onclick },
        icon(shape),
      );
    this.element = el(
      "section.map",
      { hidden: true, "aria-label": "Map" },
      this._canvas,
      this._ink,
      this._line,
      el(
        "div.tools",
        tool("Zoom in", "plus", () => this._zoom(-1)),
        tool("Zoom out", "minus", () => this._zoom(1)),
        tool("Close the map", "close", () => this.toggle()),
      ),
    );
    this._pointer = new PointerCapture(this._canvas, {
      came: (event) => this._begin(event),
      moved: (event) => this._move(event),
      gone: (event) => this._finish(event.type === "pointerup"),
    });
    tooltip.attach(this.button, () => "View from above (M)");
    tooltip.attach(
      this._canvas,
      () => planBlockedReason(link) ?? "Click to plan a path there; drag to set the heading",
    );
    link.on("map_lines", ({ routes, trails }) => {
      this._routes = routes;
      if (trails !== null) this._trails.replace(trails);
    });
    link.on("state", ({ map }) => map && this._trails.extend(map.robots));
    link.on("beat", () => this._draw());
    link.on("robot", () => this._show());
    link.on("up", () => this._isShown && this._request());
    this._restore();
  }

  get _isShown() {
    return this._isOpen && this._link.robot !== null && kindOf(this._link.robot).onFloor;
  }

  toggle() {
    if (!this._isOpen && this.button.hidden) return; // A sphere does not move.
    this._isOpen = !this._isOpen;
    this._keep();
    this._show();
  }

  /** Handle a key event; return whether it was for the map. @param {KeyboardEvent} event */
  key(event) {
    if (event.code !== "KeyM") return false;
    if (event.type === "keydown" && !event.repeat) this.toggle();
    return true;
  }

  _show() {
    const { robot } = this._link;
    this.button.hidden = robot !== null && !kindOf(robot).onFloor;
    const wasShown = !this.element.hidden;
    this.element.hidden = !this._isShown;
    setAttribute(this.button, "aria-pressed", String(this._isShown));
    if (wasShown === this._isShown) return;
    this._pointer.cancel();
    this._stroke = [];
    this._request();
    this._draw();
  }

  _request() {
    this._link.send({ t: "map", on: this._isShown });
  }

  /** @param {number} steps */
  _zoom(steps) {
    this._view.zoom(steps);
    this._keep();
    this._draw();
  }

  _keep() {
    keep(KEY, JSON.stringify({ open: this._isOpen, spanM: this._view.spanM }));
  }

  _restore() {
    const [, open] = /"open":(true|false)/.exec(recall(KEY) ?? "") ?? [];
    const [, span] = /"spanM":(\d+)/.exec(recall(KEY) ?? "") ?? [];
    this._isOpen = open === "true";
    this._view.setSpan(Number(span));
  }

  // Clicks and strokes; the map does not scroll during them.

  /** @param {PointerEvent} event */
  _begin(event) {
    clearTimeout(this._timer);
    this._stroke = this._waypoints.held ? [] : [this._place(event)]; // As in the scene.
    this._draw();
  }

  /** @param {PointerEvent} event */
  _move(event) {
    const last = this._stroke.at(-1);
    if (last === undefined) return;
    const here = this._place(event);
    const isNear = Math.hypot(here[0] - last[0], here[1] - last[1]) < MIN_STEP_PX;
    if (isNear && this._stroke.length > 1) return;
    if (this._waypoints.mode !== "draw") this._stroke.length = 1;
    this._stroke.push(here);
    this._draw();
  }

  /** @param {boolean} isUp Not cancelled. */
  _finish(isUp) {
    if (isUp && this._stroke.length > 0 && !this._waypoints.held) {
      const points = thinned(this._stroke).map((pixels) => this._view.toFloor(pixels));
      this._waypoints.plan({ kind: this._waypoints.mode ?? "to", on: "floor", points });
    }
    const clear = () => ((this._stroke = []), this._draw());
    if (isUp) this._timer = setTimeout(clear, STROKE_SHOWN_MS);
    else clear();
  }

  /** @param {PointerEvent} event @returns {[number, number]} */
  _place({ clientX, clientY }) {
    const { left, top } = this._canvas.getBoundingClientRect();
    return [clientX - left, clientY - top];
  }

  // Drawing.

  _draw() {
    const { map } = this._link.state ?? {};
    const pen = this._canvas.getContext("2d");
    if (pen === null || !this._isShown || !isVisible(this._canvas)) return;
    const { clientWidth: width, clientHeight: height } = this._canvas;
    const density = Math.min(DENSEST, devicePixelRatio);
    const size = [Math.round(width * density), Math.round(height * density)];
    if (this._canvas.width !== size[0] || this._canvas.height !== size[1])
      [this._canvas.width, this._canvas.height] = size;
    this._view.fit(freeBox(this._canvas, width, height));
    const robots = map?.robots ?? [];
    const shown = robots.find(({ id }) => id === this._link.robot?.id);
    if (shown && this._stroke.length === 0) this._view.follow([shown.pose[0], shown.pose[1]]);
    pen.setTransform(density, 0, 0, density, 0, 0);
    drawMap(pen, this._view, {
      size: { width, height },
      ink: getComputedStyle(this._ink).color,
      line: getComputedStyle(this._line).color,
      names: this._link.welcome?.robots ?? [],
      robots,
      shown,
      isStale: this._link.isStale(),
      envelope: map?.envelope ?? null,
      routes: this._routes,
      trailOf: (id) => this._trails.of(id),
      stroke: this._stroke,
    });
  }
}

/**
 * Part of the map not covered by controls; in small windows, the map lies below them.
 * @param {HTMLElement} canvas @param {number} width @param {number} height @returns {MapBox}
 */
function freeBox(canvas, width, height) {
  const style = getComputedStyle(canvas);
  const pixels = (/** @type {string} */ name) =>
    Number.parseFloat(style.getPropertyValue(name)) || 0;
  const isBelow = style.getPropertyValue("--below").trim() === "1";
  const [top, bottom] = isBelow ? [pixels("--tsd-top"), pixels("--tsd-bottom")] : [0, 0];
  // In a low window, pose and path leave no space: use the part between bar and stick.
  if (height - top - bottom < height / 3)
    return { left: 0, top: height / 3, width, height: height / 3 };
  return { left: 0, top, width, height: height - top - bottom };
}
