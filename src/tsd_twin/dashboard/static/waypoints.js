// Waypoints: click a goal or draw a path on the floor, check the plan, hold the button to follow
// it. The server plans and controls; this page reports that the button is held, and release stops
// the robot.

import { tooltip } from "./button.js";
import { el, icon, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";
import { HoldToRunButton, PointerCapture } from "./held_controls.js";
import { kindOf } from "./kinds.js";
import { assertDefined } from "./link.js";
import { LATCHED, ofPage, textOf, whyNotDrive, whyNotPlan } from "./blocked_reasons.js";
import { notice, words } from "./reasons.js";

const MODE_HINTS = {
  to: "Click on the floor; drag to set the heading",
  draw: "Draw on the floor",
};
export const MIN_STEP_PX = 5;
const MAX_POINTS = 200; // A message allows slightly more.
const STROKE_SHOWN_MS = 600;
const NO_TWIST = { vx: 0, vy: 0, omega: 0 };

/** Whether a path has ended, successfully or not. @param {RouteState | null} route */
function isFinished(route) {
  return route?.phase === "arrived" || route?.phase === "ended";
}

/**
 * Return the status text of a path, or the instruction for the mode without a path.
 * @param {RouteState | null} route @param {"to" | "draw" | null} mode
 */
function statusOf(route, mode) {
  if (route === null) return mode === null ? "" : MODE_HINTS[mode];
  const length = `${fixed(route.length_m, 2)} m`;
  return {
    planning: "Planning…",
    planned: `${length}, ${fixed(route.time_s, 1)} s`,
    going: `${fixed(route.done_m, 2)} of ${length}`,
    arrived: `Arrived, ${fixed(route.off_mm, 0)} mm off`,
    ended: `Ended: ${route.why ? words(route.why) : ""}`,
  }[route.phase];
}

/**
 * Layer over the scene, below all controls. Captures a click or stroke on the floor and shows it
 * until the planned path is visible.
 */
class FloorPicker {
  /**
   * `take` receives points as fractions of the picture size.
   * @param {(points: [number, number][]) => void} take
   */
  constructor(take) {
    this._take = take;
    this._timer = 0;
    this._mode = null;
    /** @type {[number, number][]} */
    this._points = [];
    this._line = svg("polyline.stroke");
    this._dot = svg("circle.goal", { r: 7 });
    const drawing = svg("svg", this._line, this._dot);
    this.element = el("div.floor", { hidden: true, "aria-hidden": "true" }, drawing);
    this._pointer = new PointerCapture(this.element, {
      came: (event) => this._begin(event),
      moved: (event) => this._move(event),
      gone: (event) => (event.type === "pointerup" ? this._finish() : this._clear()),
    });
  }

  /** Accept clicks, strokes or nothing. @param {"to" | "draw" | null} mode */
  open(mode) {
    this._mode = mode;
    this.element.hidden = mode === null;
    this._pointer.cancel();
    this._clear();
  }

  /** While the robot follows a path, the scene receives clicks. @param {boolean} going */
  rest(going) {
    this.element.style.pointerEvents = going ? "none" : "";
  }

  /** @param {PointerEvent} event */
  _begin(event) {
    clearTimeout(this._timer);
    this._points = [this._place(event)];
    this._draw();
  }

  /** @param {PointerEvent} event */
  _move(event) {
    const here = this._place(event);
    const [x, y] = this._points[this._points.length - 1];
    if (Math.hypot(here[0] - x, here[1] - y) < MIN_STEP_PX && this._points.length > 1) return;
    if (this._mode === "to") this._points.length = 1;
    this._points.push(here);
    this._draw();
  }

  _finish() {
    const { width, height } = this.element.getBoundingClientRect();
    /** @type {(point: [number, number]) => [number, number]} */
    const share = ([x, y]) => [clamped(x / width), clamped(y / height)];
    this._take(thinned(this._points).map(share));
    this._timer = setTimeout(() => this._clear(), STROKE_SHOWN_MS);
  }

  _clear() {
    this._points = [];
    this._draw();
  }

  /**
   * @param {PointerEvent} event
   * @returns {[number, number]}
   */
  _place(event) {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  _draw() {
    setAttribute(this._line, "points", this._points.map((point) => point.join()).join(" "));
    const at = this._mode === "to" ? this._points[0] : this._points.at(-1);
    setAttribute(this._dot, "visibility", at ? "visible" : "hidden");
    if (!at) return;
    setAttribute(this._dot, "cx", at[0]);
    setAttribute(this._dot, "cy", at[1]);
  }
}

/**
 * Drop every second point until few enough remain; keep the ends.
 * @param {[number, number][]} points
 */
export function thinned(points) {
  while (points.length > MAX_POINTS)
    points = points.filter((_, i) => i % 2 === 0 || i === points.length - 1);
  return points;
}

/** @param {number} value */
function clamped(value) {
  return Number(Math.max(0, Math.min(1, value)).toFixed(5));
}

/** Path controls. Release, or use of another control, stops the robot. */
export class Waypoints {
  /** @param {Drive} drive @param {Link} link */
  constructor(drive, link) {
    this._drive = drive;
    this._link = link;
    /** @type {"to" | "draw" | null} */
    this.mode = null;
    this._number = null; // Number of the held path.
    this._level = drive.level;
    this._end = ""; // Cause of the end of place selection: a finished path, or a stop.
    this.floor = new FloorPicker((points) => {
      if (this.mode !== null) this.plan({ points, kind: this.mode, on: "picture" });
    });
    const button = (/** @type {string} */ name, /** @type {() => void} */ onclick) =>
      el("button.button.quiet", { type: "button", "aria-pressed": "false", onclick }, name);
    this._choices = {
      to: button("Go to", () => this._toggle("to")),
      draw: button("Draw", () => this._toggle("draw")),
    };
    this._status = el("span.words.number", { role: "status", "aria-label": "Path" });
    this.button = el(
      "button.button.primary.go",
      { type: "button" },
      el("span.label", "Hold to go"),
    );
    this._close = el(
      "button.button.quiet.close",
      { type: "button", "aria-label": "Delete the path", onclick: () => this.end() },
      icon("close"),
    );
    this._row = el("div.row.going", this._status, this.button, this._close);
    this.element = el(
      "div.route.surface",
      { role: "group", "aria-label": "Path", hidden: true },
      el("div.choices", this._choices.to, this._choices.draw),
      this._row,
    );
    tooltip.attach(this._choices.to, () => "Drive to a point that you click on");
    tooltip.attach(this._choices.draw, () => "Drive along a line that you draw");
    tooltip.attach(
      this.button,
      () => textOf(this._whyNotGo()) ?? "Hold this, or G. Let go and the robot stops.",
    );
    tooltip.attach(this._close, () => "Delete the path (Esc)");
    this._hold = new HoldToRunButton(this.button, "KeyG", () => this._pressed());
    drive.onChange(() => this._checkLevel());
    link.on("state", () => this._check());
    link.on("down", () => this._show());
    link.on("robot", () => this._choose(null));
  }

  /** Planned path reported by the gateway. */
  get route() {
    return this._link.state?.route ?? null;
  }

  get held() {
    return this._number !== null;
  }

  /** @returns {FollowPlan} */
  get command() {
    return { t: "follow_plan", route: this._number };
  }

  /** The twist is known only to the gateway; hand controls end it. */
  get twist() {
    return NO_TWIST;
  }

  cancel() {
    this._number = null;
    this._hold.cancel();
    this._show();
  }

  /** Request a path. @param {PlanRequest} wish */
  plan(wish) {
    const refusal = whyNotPlan(this._link);
    if (refusal === null) this._link.send({ t: "plan", ...wish, level: this._drive.level });
    else {
      if (this.route !== null) this._link.send({ t: "clear_plan" }); // It is no longer wanted.
      const isStill = () => whyNotPlan(this._link)?.why.code === refusal.why.code;
      this._drive.onMessage(notice(refusal.text), isStill);
    }
  }

  /** Discard the path and end place selection. */
  end() {
    if (this.held) this._drive.release();
    this._link.send({ t: "clear_plan" });
    this._choose(null);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (this.element.hidden) return false;
    if (event.code === "Escape" && (this.mode !== null || this.route !== null)) {
      if (event.type === "keydown") this.end();
      return true;
    }
    return this._hold.key(event);
  }

  /** @param {"to" | "draw"} mode */
  _toggle(mode) {
    this._choose(this.mode === mode ? null : mode);
  }

  /** @param {"to" | "draw" | null} mode */
  _choose(mode) {
    this.mode = mode;
    for (const [name, button] of Object.entries(this._choices))
      setAttribute(button, "aria-pressed", String(name === mode));
    this.floor.open(mode);
    this._show();
  }

  /** A finger or key was pressed or released. */
  _pressed() {
    if (!this._hold.down) {
      this._number = null;
      this._drive.changed();
    } else if (!this.held) {
      const refusal = this._whyNotGo();
      if (refusal !== null) {
        this.cancel();
        const isStill = () => this._whyNotGo()?.why.code === refusal.why.code;
        this._drive.onMessage(notice(refusal.text), isStill);
        return;
      }
      this._number = this.route?.number ?? null;
      this._drive.changed();
    }
    this._show();
  }

  /** @returns {import("./blocked_reasons.js").Refusal | null} */
  _whyNotGo() {
    const refusal = whyNotDrive(this._link);
    if (refusal !== null) return refusal;
    if (this.held) return null;
    if (this._drive.held || this._link.state?.status.mode === "driving")
      return ofPage("still_moves", "The robot still moves: let go of the other controls.");
    if (this.route?.phase === "planned") return null;
    return ofPage("no_path", "There is no path: click on the floor first.");
  }

  _check() {
    const route = this.route;
    const lost = route === null || route.number !== this._number || route.phase === "arrived";
    if (this.held && lost) {
      this.cancel();
      this._drive.changed();
    }
    const { mode } = assertDefined(this._link.state).status;
    const end = LATCHED.has(mode) ? "stop" : isFinished(route) ? `path ${route?.number}` : "";
    if (end !== this._end && end !== "") this._choose(null); // Frees the camera.
    this._end = end;
    this._show();
  }

  _checkLevel() {
    if (this._level === this._drive.level) return;
    this._level = this._drive.level;
    if (this.route !== null) this._link.send({ t: "speed_level", level: this._level });
  }

  _show() {
    const { robot, state } = this._link;
    this.element.hidden = robot === null || !kindOf(robot).onFloor || !state?.has_control;
    if (this.element.hidden && this.mode !== null) this._choose(null);
    const isOver = isFinished(this.route);
    const route = isOver && this.mode !== null ? null : this.route;
    this._row.hidden = this.mode === null && route === null;
    setText(this._status, statusOf(route, this.mode));
    // Do not announce 20 updates per second.
    setAttribute(this._status, "aria-live", route?.phase === "going" ? "off" : "polite");
    setAttribute(this.button, "aria-disabled", textOf(this._whyNotGo()) === null ? null : "true");
    this.button.toggleAttribute("data-held", this.held);
    this._row.toggleAttribute("data-plain", route === null || isOver);
    const done = route && route.length_m > 0 ? route.done_m / route.length_m : 0;
    this._row.style.setProperty("--done", done.toFixed(3));
    this.floor.rest(this.held);
  }
}
