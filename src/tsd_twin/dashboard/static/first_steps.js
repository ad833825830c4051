// First steps: a self-checking list, shown on the first visit and on demand. It is part of the
// column of notices, so it covers no controls.

import { Button } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";
import { kindOf } from "./kinds.js";
import { assertDefined } from "./link.js";
import { keep, recall } from "./memory.js";
import { isReadOnly } from "./blocked_reasons.js";

const KEY = "tsd.hints";
const DONE_MS = 4000; // Time for which the last tick stays visible.
const ARMED = new Set(["arming", "ready", "driving"]);

/** @typedef {{ name: string, hint: (robot: RobotInfo | null, state: RobotState) => string, done: (state: RobotState) => boolean }} Step */

/** @type {Step[]} */
const STEPS = [
  {
    name: "Take control",
    hint: (_, { status }) =>
      status.lease.holder === null
        ? "One operator drives at a time."
        : "Ask for control: one operator drives at a time.",
    done: ({ has_control: drives }) => drives,
  },
  {
    name: "Arm",
    hint: (robot) => kindOf(robot).armHint,
    done: ({ has_control: drives, status }) => drives && ARMED.has(status.mode),
  },
  {
    name: "Drive",
    hint: () => "Push the stick, or hold W A S D or Q E. Let go and the robot stops.",
    done: ({ has_control: drives, status }) => drives && status.mode === "driving",
  },
  {
    name: "Stop",
    hint: () => "STOP, or the space bar, works in every state.",
    done: ({ status }) => status.mode === "stopped",
  },
  {
    name: "Reset",
    hint: () => "Hold Reset stop for a second. Then arm again.",
    done: ({ status }) => status.mode === "disarmed",
  },
];

export class FirstSteps {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._at = STEPS.length; // Index of the next step.
    this._isOpen = false;
    this._timer = 0;
    this._hint = el("p.then");
    this._items = STEPS.map(({ name }) => {
      const tick = el("span.tick", icon("disarmed"));
      return { tick, item: el("li", tick, el("span", name)) };
    });
    const skip = new Button("Skip", () => this._close(), { kind: "quiet" });
    this.element = el(
      "section.steps.surface",
      { hidden: true, "aria-label": "First steps" },
      el("ol", ...this._items.map(({ item }) => item)),
      this._hint,
      el("div.row", skip.element),
    );
    link.on(["state", "down", "robot"], () => this._draw());
    if (recall(KEY) === null) this.open();
  }

  /** Show the list from the beginning. */
  open() {
    clearTimeout(this._timer);
    this._timer = 0;
    this._isOpen = true;
    this._at = 0;
    this._draw();
  }

  _close() {
    clearTimeout(this._timer);
    this._timer = 0;
    this._isOpen = false;
    keep(KEY, "seen");
    this._draw();
  }

  _draw() {
    const { state, robot } = this._link;
    this.element.hidden = !this._isOpen || this._link.isStale() || isReadOnly(this._link);
    if (this.element.hidden) return;
    while (this._at < STEPS.length && STEPS[this._at].done(assertDefined(state))) this._at += 1;
    this._items.forEach(({ tick, item }, i) => {
      const isDone = i < this._at;
      if (item.hasAttribute("data-done") !== isDone) tick.replaceChildren(mark(isDone));
      item.toggleAttribute("data-done", isDone);
      setAttribute(item, "aria-current", i === this._at ? "step" : null);
    });
    const isOver = this._at === STEPS.length;
    setText(
      this._hint,
      isOver ? "That is all." : STEPS[this._at].hint(robot, assertDefined(state)),
    );
    if (isOver) this._timer ||= setTimeout(() => this._close(), DONE_MS);
  }
}

/** @param {boolean} isDone */
function mark(isDone) {
  const said = isDone ? el("span.sr", "done: ") : "";
  return el("span", icon(isDone ? "tick" : "disarmed"), said);
}
