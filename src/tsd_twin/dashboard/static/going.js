// Going to a place that is clicked on, or along a line that is drawn: what there is to see and to
// press. The gateway plans and steers; this page says, while a finger or a key holds the button,
// that it does. Let go, or hands on any other control, and the robot stops.

import { el, icon, mark, say } from "./dom.js";
import { FloorLayer } from "./floor.js";
import { HeldButton } from "./held_button.js";
import { notDrive, notPlan } from "./permission.js";
import { isOver, wordsOf } from "./route_words.js";

const NONE = { vx: 0, vy: 0, omega: 0 };
export class Going {
  constructor(drive, link, tips) {
    this._drive = drive;
    this._link = link;
    this._mode = null;
    this._number = null; // Of the way that is held.
    this._level = drive.level;
    this._over = null; // The way that has come to its end.
    this.floor = new FloorLayer((points) => this.plan({ points, kind: this._mode, on: "picture" }));
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
    this._words = el("span", { class: "words number", role: "status", "aria-label": "Path" });
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
    this._row = el("div", { class: "row going" }, this._words, this.button, this._close);
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
    this._hold = new HeldButton(this.button, "KeyG", () => this._pressed());
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

  get command() {
    return { t: "go", route: this._number };
  }

  /** What is asked for is known to the gateway only; hands on the stick end it. */
  get twist() {
    return NONE;
  }

  cancel() {
    this._number = null;
    this._hold.cancel();
    this._show();
  }

  // What is wished.

  /** Ask for a way; return why that cannot be, or null. */
  plan(wish) {
    const reason = notPlan(this._link);
    if (reason !== null) this._drive.onMessage(reason);
    else this._link.send({ t: "plan", ...wish, level: this._drive.level });
    return reason;
  }

  /** Forget the way, and point at nothing any more. */
  end() {
    if (this.held) this._drive.letGo();
    this._link.send({ t: "unplan" });
    this._choose(null);
  }

  /** Take a key: G, or Enter on the button, holds it; Escape forgets the way. */
  key(event) {
    if (this.element.hidden) return false;
    if (event.code === "Escape" && (this._mode !== null || this.route !== null)) {
      if (event.type === "keydown") this.end();
      return true;
    }
    return this._hold.key(event);
  }

  _choose(mode) {
    this._mode = mode;
    for (const [name, button] of Object.entries(this._choices))
      mark(button, "aria-pressed", String(name === mode));
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
      this._number = this.route.number;
      this._drive.changed();
    }
    this._show();
  }

  _notGo() {
    const reason = notDrive(this._link);
    if (reason !== null) return reason;
    if (this.held) return null;
    if (this._drive.held || this._link.state.status.mode === "driving")
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
    const over = isOver(route) ? route.number : null;
    const news = over !== this._over;
    this._over = over;
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
    const over = isOver(this.route);
    const route = over && this._mode !== null ? null : this.route;
    this._row.hidden = this._mode === null && route === null;
    say(this._words, wordsOf(route, this._mode));
    // Twenty numbers a second are not to be read out.
    mark(this._words, "aria-live", route?.phase === "going" ? "off" : "polite");
    mark(this.button, "aria-disabled", this._notGo() === null ? null : "true");
    mark(this.button, "data-held", this.held ? "" : null);
    mark(this._row, "data-plain", route === null || over ? "" : null);
    const done = route && route.length_m > 0 ? route.done_m / route.length_m : 0;
    this._row.style.setProperty("--done", done.toFixed(3));
    this.floor.rest(this.held);
  }
}
