// The speed level: what a full stick means, in percent of the robot's limits.

import { el, setAttribute } from "./dom.js";
import { fixed } from "./format.js";

const FALLBACK = [20, 50, 80, 100];

export class SpeedLevel {
  /** @param {Link} link @param {Drive} drive @param {Tooltip} tips */
  constructor(link, drive, tips) {
    this._drive = drive;
    /** @type {number[]} */
    this._choices = [];
    this._group = el("span", {
      class: "levels",
      role: "radiogroup",
      "aria-label": "Speed level",
      onkeydown: (event) => this._key(event),
    });
    this.element = el(
      "span",
      { class: "level-control" },
      el("span", { class: "caption", "aria-hidden": "true" }, "Level"),
      this._group,
    );
    tips.attach(this._group, () => this._explain(link.state?.status.limits));
    link.on("robot", (robot) => this._offer(robot.levels));
    this._offer(FALLBACK);
  }

  /** @param {LimitStatus | undefined} limits */
  _explain(limits) {
    const what = "How fast a full stick drives, in percent of the limits.";
    if (limits === undefined) return what;
    return (
      `${what} The speed limit is ${fixed(limits.speed_mps, 2)} m/s. ` +
      `From there the robot stops within ${fixed(limits.stop_allowance_m, 2)} m if the link fails.`
    );
  }

  /** @param {number[]} levels */
  _offer(levels) {
    if (levels.join() === this._choices.join()) return;
    this._choices = [...levels];
    this._group.replaceChildren(
      ...levels.map((level) =>
        el(
          "button",
          {
            type: "button",
            role: "radio",
            "data-level": level,
            "aria-label": `${level} %`,
            onclick: () => this._set(level),
          },
          String(level),
        ),
      ),
      el("span", { class: "unit", "aria-hidden": "true" }, "%"),
    );
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
    const at = this._choices.indexOf(this._drive.level) + step;
    this._set(this._choices[Math.max(0, Math.min(this._choices.length - 1, at))]);
    /** @type {HTMLElement | null} */ (this._group.querySelector("[aria-checked=true]"))?.focus();
  }
}
