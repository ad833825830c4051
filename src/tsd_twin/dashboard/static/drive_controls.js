// Main controls: drive stick, turn slider, speed level and STOP.

import { tooltip } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { SpringControl } from "./held_controls.js";
import { showsRecording } from "./blocked_reasons.js";
import { words } from "./reasons.js";

const STICK_MARGIN_PX = 22; // Half of the knob, which stays inside.
const TURN_MARGIN_PX = 28;
const FALLBACK_LEVELS = [20, 50, 80, 100];

/** Drive stick: up is forward, left is left. */
export class Joystick extends SpringControl {
  /** @param {Drive} drive */
  constructor(drive) {
    const asked = el("div.asked");
    const allowed = el("div.allowed", { hidden: true });
    const gap = el("div.gap", { hidden: true });
    const worldX = el("div.world-x", { hidden: true, "aria-hidden": "true" }, "x");
    const pad = el(
      "div.pad",
      {
        role: "region",
        "aria-label": "Drive stick",
        "aria-describedby": "stick-value stick-help",
        tabindex: 0,
      },
      ...[el("div.level"), worldX, gap, allowed, asked],
    );
    super(pad, STICK_MARGIN_PX, () => drive.changed());
    this.unit = { x: 0, y: 0, turn: 0 };
    this.pad = pad;
    this.help = el("span.sr", { id: "stick-help" });
    this._value = el("span.sr", { id: "stick-value" });
    this.head = el("div.caption-row", el("div.caption", { "aria-hidden": "true" }, "Drive"));
    this.element = el("div.control.stick", this.head, pad, this._value, this.help);
    this._drive = drive;
    this._asked = asked;
    this._allowed = allowed;
    this._gap = gap;
    this._worldX = worldX;
  }

  /** @param {number} right @param {number} up */
  place(right, up) {
    const length = Math.max(1, Math.hypot(right, up));
    this.unit = { x: up / length, y: -right / length, turn: 0 };
  }

  /** Mark the world's x axis on the rim, `angle` clockwise from up. @param {number | null} angle */
  point(angle) {
    this._worldX.hidden = angle === null;
    this._worldX.style.setProperty("rotate", `${(angle ?? 0).toFixed(3)}rad`);
  }

  /**
   * Draw the input and the motion the robot makes of it, as fractions of the speed level.
   * @param {Unit} unit @param {Unit | null} allowed @param {StickLabels} labels
   */
  draw(unit, allowed, [forward, left, word]) {
    const { level, scale } = this._drive;
    placeKnob(this._asked, unit.x, unit.y);
    this.pad.style.setProperty("--level", String(level / 100));
    const said = [unit.x, unit.y].map((share) => fixed(share * scale.speed, 2));
    setText(this._value, `${forward} ${said[0]}, ${left} ${said[1]} ${word}.`);
    this._allowed.hidden = this._gap.hidden = allowed === null;
    if (allowed === null) return;
    const length = Math.max(1, Math.hypot(allowed.x, allowed.y));
    const [x, y] = [allowed.x / length, allowed.y / length];
    const [ahead, aside] = [unit.x - x, unit.y - y];
    placeKnob(this._allowed, x, y);
    placeKnob(this._gap, x, y);
    this._gap.style.setProperty("--length", Math.hypot(ahead, aside).toFixed(4));
    this._gap.style.setProperty("--angle", `${Math.atan2(-aside, -ahead).toFixed(4)}rad`);
  }
}

/** @param {HTMLElement} node @param {number} x @param {number} y */
function placeKnob(node, x, y) {
  node.style.setProperty("--right", (-y).toFixed(4));
  node.style.setProperty("--up", x.toFixed(4));
}

/** Turn slider: left turns left, counter-clockwise seen from above. */
export class TurnSlider extends SpringControl {
  /** @param {Drive} drive */
  constructor(drive) {
    const asked = el("div.asked");
    const allowed = el("div.allowed", { hidden: true });
    const range = { "aria-valuemin": -100, "aria-valuemax": 100, "aria-valuenow": 0 };
    const track = el(
      "div.track",
      { role: "slider", "aria-label": "Turn", tabindex: 0, ...range },
      ...[el("div.centre"), allowed, asked],
    );
    super(track, TURN_MARGIN_PX, () => drive.changed());
    this.unit = { x: 0, y: 0, turn: 0 };
    this.track = track;
    this.element = el(
      "div.control.turn",
      el("div.caption", { "aria-hidden": "true" }, "Turn"),
      this.track,
    );
    this._asked = asked;
    this._allowed = allowed;
  }

  /** @param {number} right */
  place(right) {
    this.unit = { x: 0, y: 0, turn: Math.max(-1, Math.min(1, -right)) };
  }

  /**
   * Draw the input and the motion the robot makes of it, as fractions of the speed level.
   * @param {number} turn @param {number | null} allowed @param {number} omega
   */
  draw(turn, allowed, omega) {
    this._asked.style.setProperty("--right", (-turn).toFixed(4));
    this._allowed.hidden = allowed === null;
    const right = Math.max(-1, Math.min(1, -(allowed ?? 0)));
    this._allowed.style.setProperty("--right", right.toFixed(4));
    setAttribute(this.track, "aria-valuenow", Math.round(100 * turn));
    const side = turn === 0 ? "" : turn > 0 ? " left" : " right";
    setAttribute(this.track, "aria-valuetext", `${fixed(Math.abs(omega), 2)} rad/s${side}`);
  }
}

/** Speed at full stick, in percent of the robot's limits. */
export class SpeedLevel {
  /** @param {Link} link @param {Drive} drive */
  constructor(link, drive) {
    this._drive = drive;
    /** @type {number[]} */
    this._levels = [];
    this._group = el("span.levels", {
      role: "radiogroup",
      "aria-label": "Speed level",
      onkeydown: (event) => this._key(event),
    });
    this.element = el(
      "span.level-control",
      el("span.caption", { "aria-hidden": "true" }, "Speed"),
      this._group,
    );
    tooltip.attach(this._group, () => explainLevel(link.state?.status.limits, link.robot));
    link.on("robot", (robot) => this._offer(robot.levels));
    this._offer(FALLBACK_LEVELS);
  }

  /** @param {number[]} levels */
  _offer(levels) {
    if (levels.join() === this._levels.join()) return;
    this._levels = [...levels];
    const button = (/** @type {number} */ level) => {
      const label = { "data-level": level, "aria-label": `${level} %` };
      const onclick = () => this._set(level);
      return el("button", { type: "button", role: "radio", ...label, onclick }, String(level));
    };
    const unit = el("span.unit", { "aria-hidden": "true" }, "%");
    this._group.replaceChildren(...levels.map(button), unit);
    this._set(levels.includes(this._drive.level) ? this._drive.level : levels[0]);
  }

  /** @param {number} level */
  _set(level) {
    this._drive.level = level;
    for (const choice of this._group.querySelectorAll("button")) {
      const chosen = choice.dataset.level === String(level);
      setAttribute(choice, "aria-checked", String(chosen));
      choice.tabIndex = chosen ? 0 : -1;
    }
    this._drive.changed();
  }

  /** @param {KeyboardEvent} event */
  _key(event) {
    /** @type {Record<string, number>} */
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };
    const step = steps[event.key];
    if (step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const at = this._levels.indexOf(this._drive.level) + step;
    this._set(this._levels[Math.max(0, Math.min(this._levels.length - 1, at))]);
    /** @type {HTMLElement | null} */ (this._group.querySelector("[aria-checked=true]"))?.focus();
  }
}

/** @param {LimitStatus | undefined} limits @param {RobotInfo | null} robot */
function explainLevel(limits, robot) {
  const what = "Speed of a full stick, in percent of the limits.";
  if (limits === undefined) return what;
  const stop = robot?.not_promised.length
    ? "and where the robot stops if the link fails is not promised."
    : `from which the robot stops within ${fixed(limits.stop_allowance_m, 2)} m if the link fails.`;
  return (
    `${what} 100 % is ${fixed(limits.speed_mps, 2)} m/s, ${stop}` +
    (limits.why?.length
      ? ` Slower than usual: ${limits.why.map((why) => words(why)).join("; ")}.`
      : "")
  );
}

/** STOP button: works in every state, for everyone. */
export class StopButton {
  /** @param {Link} link @param {() => void} stop */
  constructor(link, stop) {
    this.button = el(
      "button.stop",
      { type: "button", "aria-label": "STOP", "aria-describedby": "stop-help" },
      {
        // Not click, which a second finger does not trigger while the first holds the stick.
        onpointerdown: (event) => {
          event.preventDefault();
          stop();
        },
        onclick: stop, // Keyboard and assistive technology.
        oncontextmenu: (event) => event.preventDefault(),
      },
      icon("stopped"),
      el("span.label", "STOP"),
    );
    const help =
      "Software stop, also with the space bar. It is no emergency stop, which cuts the power.";
    this.element = el(
      "div.control.stopping",
      this.button,
      el("span.sr", { id: "stop-help" }, help),
    );
    tooltip.attach(
      this.button,
      () => "Software stop (space bar). It is no emergency stop, which cuts the power.",
    );
    link.on(["state", "down"], () => {
      const mode = link.isStale() ? "" : link.state?.status.mode;
      const isCalm = mode === "stopped" || mode === "fault";
      this.button.toggleAttribute("data-calm", isCalm && !showsRecording(link));
    });
  }
}
