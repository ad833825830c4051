// Waypoints: click a goal or draw a path on the floor, see the plan, hold the button to follow it.
// The server plans and steers. This page reports that the button is held; on release the robot stops.

import { el, icon, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";
import { HoldToRunButton } from "./held_controls.js";
import { notDrive, notPlan } from "./permission.js";

// What is said about a way.
const FINISHED_PHASES = new Set(["arrived", "ended"]);
const MODE_HINTS = {
  to: "Click on the floor, drag to say where to look",
  draw: "Draw on the floor",
};

/**
 * Return whether it has come to its end, good or bad.
 * @param {RouteState | null | undefined} route
 */
export function isFinished(route) {
  return route != null && FINISHED_PHASES.has(route.phase);
}

/**
 * Return the status text of a route, or without one the instruction of the mode.
 * @param {RouteState | null | undefined} route
 * @param {"to" | "draw" | null} mode
 */
export function statusOf(route, mode) {
  switch (route?.phase) {
    case "planning":
      return "Planning…";
    case "planned":
      return `${fixed(route.length_m, 2)} m, ${fixed(route.time_s, 1)} s`;
    case "going":
      return `${fixed(route.done_m, 2)} of ${fixed(route.length_m, 2)} m`;
    case "arrived":
      return `Arrived, ${fixed(route.off_mm, 0)} mm off`;
    case "ended":
      return `Ended: ${route.reason}`;
  }
  return mode === null ? "" : MODE_HINTS[mode];
}

// The floor under a finger: a layer over the scene, below all controls, that takes a click or a
// stroke and shows it until the way that is made of it is seen.
const MIN_STEP_PX = 5;
const MAX_POINTS = 200; // A message has room for a few more.
const STROKE_SHOWN_MS = 600;

export class FloorPicker {
  /**
   * `take(points)` gets shares of the picture, right and down.
   * @param {(points: [number, number][]) => void} take
   */
  constructor(take) {
    this._take = take;
    /** @type {"to" | "draw" | null} */
    this._mode = null;
    /** @type {number | null} */
    this._pointer = null;
    /** @type {[number, number][]} */
    this._points = [];
    this._line = svg("polyline", { class: "stroke" });
    this._dot = svg("circle", { class: "goal", r: 7 });
    this.element = el(
      "div",
      { class: "floor", hidden: true, "aria-hidden": "true" },
      svg("svg", {}, this._line, this._dot),
    );
    this.element.addEventListener("pointerdown", (event) => this._begin(event));
    this.element.addEventListener("pointermove", (event) => this._move(event));
    this.element.addEventListener("pointerup", (event) => this._finish(event));
    for (const end of /** @type {const} */ (["pointercancel", "lostpointercapture"]))
      this.element.addEventListener(
        end,
        (event) => event.pointerId === this._pointer && this._clear(),
      );
    this.element.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /**
   * Take clicks (`to`), strokes (`draw`), or nothing: then the scene has them.
   * @param {"to" | "draw" | null} mode
   */
  open(mode) {
    this._mode = mode;
    this.element.hidden = mode === null;
    this._clear();
  }

  /**
   * While the robot goes, the scene has the clicks.
   * @param {boolean} going
   */
  rest(going) {
    this.element.style.pointerEvents = going ? "none" : "";
  }

  /** @param {PointerEvent} event */
  _begin(event) {
    if (this._pointer !== null || event.button !== 0) return;
    event.preventDefault();
    clearTimeout(this._timer);
    this._pointer = event.pointerId;
    this.element.setPointerCapture(event.pointerId);
    this._points = [this._place(event)];
    this._draw();
  }

  /** @param {PointerEvent} event */
  _move(event) {
    if (event.pointerId !== this._pointer) return;
    const here = this._place(event);
    const [x, y] = this._points[this._points.length - 1];
    if (Math.hypot(here[0] - x, here[1] - y) < MIN_STEP_PX && this._points.length > 1) return;
    if (this._mode === "to") this._points.length = 1;
    this._points.push(here);
    this._draw();
  }

  /** @param {PointerEvent} event */
  _finish(event) {
    if (event.pointerId !== this._pointer) return;
    this._pointer = null;
    const { width, height } = this.element.getBoundingClientRect();
    /** @type {[number, number][]} */
    const points = thinned(this._points).map(([x, y]) => [share(x / width), share(y / height)]);
    this._take(points);
    this._timer = setTimeout(() => this._clear(), STROKE_SHOWN_MS);
  }

  _clear() {
    this._pointer = null;
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
    this._line.setAttribute("points", this._points.map((point) => point.join()).join(" "));
    const at = this._mode === "to" ? this._points[0] : this._points.at(-1);
    this._dot.setAttribute("visibility", at ? "visible" : "hidden");
    if (!at) return;
    this._dot.setAttribute("cx", String(at[0]));
    this._dot.setAttribute("cy", String(at[1]));
  }
}

/**
 * Return every second point, again and again until they are few; ends stay.
 * @param {[number, number][]} points
 */
function thinned(points) {
  while (points.length > MAX_POINTS)
    points = points.filter((_, i) => i % 2 === 0 || i === points.length - 1);
  return points;
}

/** @param {number} value */
function share(value) {
  return Number(Math.max(0, Math.min(1, value)).toFixed(5));
}

// Waypoint controls. On release, or when another control is used, the robot stops.
const NO_TWIST = { vx: 0, vy: 0, omega: 0 };
export class Waypoints {
  /** @param {Drive} drive @param {Link} link @param {Tooltip} tips */
  constructor(drive, link, tips) {
    this._drive = drive;
    this._link = link;
    /** @type {"to" | "draw" | null} */
    this._mode = null;
    /** @type {number | null} */
    this._number = null; // Of the way that is held.
    this._level = drive.level;
    /** @type {number | null} */
    this._finishedNumber = null; // The way that has come to its end.
    this.floor = new FloorPicker((points) => {
      if (this._mode !== null) this.plan({ points, kind: this._mode, on: "picture" });
    });
    /** @type {(mode: "to" | "draw", name: string) => HTMLButtonElement} */
    const choice = (mode, name) =>
      el(
        "button",
        {
          type: "button",
          class: "button quiet",
          "aria-pressed": "false",
          onclick: () => this._choose(this._mode === mode ? null : mode),
        },
        name,
      );
    this._choices = { to: choice("to", "Go to"), draw: choice("draw", "Draw") };
    this._status = el("span", { class: "words number", role: "status", "aria-label": "Path" });
    this.button = el(
      "button",
      { type: "button", class: "button primary go", "aria-label": "Go along the path: hold" },
      el("span", { class: "label" }, "Hold to go"),
    );
    this._close = el(
      "button",
      {
        type: "button",
        class: "button quiet close",
        "aria-label": "Forget the path",
        onclick: () => this.end(),
      },
      icon("close"),
    );
    this._row = el("div", { class: "row going" }, this._status, this.button, this._close);
    this.element = el(
      "div",
      { class: "route surface", role: "group", "aria-label": "Path", hidden: true },
      el("div", { class: "choices" }, this._choices.to, this._choices.draw),
      this._row,
    );
    tips.attach(this._choices.to, () => "Drive to a place that you click on");
    tips.attach(this._choices.draw, () => "Drive along a line that you draw");
    tips.attach(this.button, () => this._notGo() ?? "Hold, or hold G. Let go and the robot stops.");
    tips.attach(this._close, () => "Forget the path (Esc)");
    this._hold = new HoldToRunButton(this.button, "KeyG", () => this._pressed());
    drive.onChange(() => this._checkLevel());
    link.on("state", () => this._check());
    link.on("down", () => this._show());
    link.on("robot", () => this._choose(null));
  }

  /** What is planned, as the gateway says. */
  get route() {
    return this._link.state?.route ?? null;
  }

  // A source of motion.

  get held() {
    return this._number !== null;
  }

  /** @returns {FollowPlan} */
  get command() {
    return { t: "go", route: this._number };
  }

  /** What is asked for is known to the gateway only; hands on the stick end it. */
  get twist() {
    return NO_TWIST;
  }

  cancel() {
    this._number = null;
    this._hold.cancel();
    this._show();
  }

  // What is wished.

  /**
   * Ask for a way; return why that cannot be, or null.
   * @param {PlanRequest} wish
   */
  plan(wish) {
    const reason = notPlan(this._link);
    if (reason !== null) this._drive.onMessage(reason);
    else this._link.send({ t: "plan", ...wish, level: this._drive.level });
    return reason;
  }

  /** Forget the way, and point at nothing any more. */
  end() {
    if (this.held) this._drive.release();
    this._link.send({ t: "unplan" });
    this._choose(null);
  }

  /**
   * Take a key: G, or Enter on the button, holds it; Escape forgets the way.
   * @param {KeyboardEvent} event
   */
  key(event) {
    if (this.element.hidden) return false;
    if (event.code === "Escape" && (this._mode !== null || this.route !== null)) {
      if (event.type === "keydown") this.end();
      return true;
    }
    return this._hold.key(event);
  }

  /** @param {"to" | "draw" | null} mode */
  _choose(mode) {
    this._mode = mode;
    for (const [name, button] of Object.entries(this._choices))
      setAttribute(button, "aria-pressed", String(name === mode));
    this.floor.open(mode);
    this._show();
  }

  /** A finger or a key has come or gone. */
  _pressed() {
    if (!this._hold.down) {
      this._number = null;
      this._drive.changed();
    } else if (!this.held) {
      const reason = this._notGo();
      if (reason !== null) {
        this.cancel();
        this._drive.onMessage(reason);
        return;
      }
      this._number = this.route?.number ?? null;
      this._drive.changed();
    }
    this._show();
  }

  _notGo() {
    const reason = notDrive(this._link);
    if (reason !== null) return reason;
    if (this.held) return null;
    if (this._drive.held || this._link.state?.status.mode === "driving")
      return "The robot still moves: let go of the other controls.";
    return this.route?.phase === "planned" ? null : "There is no path: click on the floor first.";
  }

  _check() {
    const route = this.route;
    const lost = route === null || route.number !== this._number || route.phase === "arrived";
    if (this.held && lost) {
      this.cancel();
      this._drive.changed();
    }
    const over = route !== null && isFinished(route) ? route.number : null;
    const news = over !== this._finishedNumber;
    this._finishedNumber = over;
    if (news && over !== null) this._choose(null); // What came of it is said; the camera turns again.
    this._show();
  }

  _checkLevel() {
    if (this._level === this._drive.level) return;
    this._level = this._drive.level;
    if (this.route !== null) this._link.send({ t: "pace", level: this._level });
  }

  _show() {
    const { robot, state } = this._link;
    this.element.hidden = robot?.space !== "floor" || !state?.you;
    if (this.element.hidden && this._mode !== null) this._choose(null);
    const over = isFinished(this.route);
    const route = over && this._mode !== null ? null : this.route;
    this._row.hidden = this._mode === null && route === null;
    setText(this._status, statusOf(route, this._mode));
    // Twenty numbers a second are not to be read out.
    setAttribute(this._status, "aria-live", route?.phase === "going" ? "off" : "polite");
    setAttribute(this.button, "aria-disabled", this._notGo() === null ? null : "true");
    setAttribute(this.button, "data-held", this.held ? "" : null);
    setAttribute(this._row, "data-plain", route === null || over ? "" : null);
    const done = route && route.length_m > 0 ? route.done_m / route.length_m : 0;
    this._row.style.setProperty("--done", done.toFixed(3));
    this.floor.rest(this.held);
  }
}
