// Sheet of keys and scene colours, toggled with `?`.

import { Button } from "./button.js";
import { el } from "./dom.js";

/** @type {[string, string][]} */
const KEYS = [
  ["Space", "STOP, wherever the focus is; B of a gamepad"],
  ["W A S D", "drive; left stick of a gamepad"],
  ["Q E", "turn left, right; right stick"],
  ["G", "hold to go along the path"],
  ["M", "open or close the map"],
  ["1 2 3", "camera: 3-D, top, chase"],
  ["K", "of a recording: play, pause"],
  ["N P", "of a recording: next, previous event or mark"],
  [". ,", "of a recording: one status on, one back"],
  ["B", "of a recording: mark this time with a note"],
  ["L", "back to the live robots, or to now"],
  ["Esc", "delete the path; close this sheet"],
  ["Tab", "go to the next control; STOP is the first"],
  ["Enter", "press a button, tick a box; hold it on Reset stop"],
  ["← ↑ → ↓", "move the stick, the turn slider or a slider that has the focus"],
  ["?", "open or close this sheet"],
];

/** Colours as in scene/appearance.py. @type {[string, string, string][]} */
const COLOURS = [
  ["estimate", "#2484e3", "estimated path, and regions that position and heading are in"],
  ["setpoint", "#00c8d7", "where the gimbals should be"],
  ["thrust", "#f0960a", "push of each wheel"],
  ["route", "#966eff", "planned path"],
  ["envelope", "#e85a3c", "how far the robot can still get if the link fails"],
  ["predicted", "#eb50a0", "where the robot will be when a command sent now arrives"],
  ["truth", "#3cbe5a", "where a simulated robot really is"],
  ["other", "#e85678", "the other estimate, of robots that have two"],
  ["preview", "#be46e6", "what the sliders would do, in mode preview"],
  ["suspect", "#e12828", "a wheel that does not follow"],
  ["past", "#f5bd4a", "a ghost: where the robot was some seconds ago"],
  ["stale", "#80848a", "a robot that is silent"],
];

export class KeySheet {
  /** @param {ShadowRoot} root */
  constructor(root) {
    this._root = root;
    /** @type {Element | null} */
    this._before = null; // Previously focused element.
    this._close = new Button("Close", () => this.toggle(), { kind: "quiet" });
    const keys = KEYS.map(([key, what]) => el("div", el("dt", el("kbd", key)), el("dd", what)));
    const colours = COLOURS.map(([name, colour, what]) => {
      const mark = el("i", { "data-colour": name, style: `background:${colour}` });
      return el("div", el("dt", mark, el("span.sr", name)), el("dd", what));
    });
    this.element = el(
      "section.sheet.surface",
      { hidden: true, role: "dialog", "aria-label": "Keys and colours" },
      el(
        "div.columns",
        el("div", el("h2", "Keys"), el("dl", ...keys)),
        el("div", el("h2", "Colours in the scene"), el("dl", ...colours)),
      ),
      el("div.row", this._close.element),
    );
  }

  toggle() {
    const opens = this.element.hidden;
    if (opens) this._before = this._root.activeElement ?? document.activeElement;
    this.element.hidden = !opens;
    if (opens) this._close.button.focus();
    else if (this._before instanceof HTMLElement) this._before.focus();
  }

  /** Handle a key event; return whether it was for the sheet. @param {KeyboardEvent} event */
  key(event) {
    const isForSheet = event.key === "?" || (event.code === "Escape" && !this.element.hidden);
    if (!isForSheet) return false;
    if (event.type === "keydown" && !event.repeat) this.toggle();
    return true;
  }
}
