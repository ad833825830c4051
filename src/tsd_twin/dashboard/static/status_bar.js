// Status bar: robot, mode, lease holder and link quality.

import { Button } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { known, quality } from "./link.js";
import { notArm, notDisarm, notTake } from "./permission.js";

const AT_REST = new Set(["disarmed", "stopped", "fault"]);
/** @type {Record<string, string>} */
const WORDS = { good: "good", fair: "fair", poor: "poor", none: "" };
const FAR_MS = 120; // From here on commands would be late too often for the usual age limit.

export class StatusBar {
  /**
   * @param {Link} link
   * @param {Tooltip} tips
   * @param {{ handOver: () => import("./handover.js").HandOver, fold: () => void }} callbacks
   */
  constructor(link, tips, { handOver, fold }) {
    this._link = link;
    this._handOver = handOver;
    /** @type {boolean} */
    this._armed = false;
    /** @type {string | null} */
    this._shownMode = null;
    this._shownGrade = "";
    this._robots = el("select", { "aria-label": "Robot", onchange: () => this._choose() });
    this._modeIcon = el("span", { class: "shape" });
    this._modeWord = el("span");
    this._mode = el(
      "span",
      { class: "mode", role: "status", "aria-label": "Mode" },
      this._modeIcon,
      this._modeWord,
    );
    this._name = el("span", { class: "name" });
    this._does = el("span");
    this._who = el("span", { class: "who" }, this._name, " ", this._does);
    this._dot = el("span", { class: "shape" });
    this._grade = el("span", { class: "word" });
    this._ms = el("span", { class: "number" });
    this._linkStatus = el(
      "span",
      { class: "link", role: "status", "aria-live": "off", "aria-label": "Link", tabindex: "0" },
      this._dot,
      this._grade,
      this._ms,
    );
    this._volts = el("span", { class: "number" });
    this._battery = el("span", { class: "battery", hidden: true }, icon("battery"), this._volts);
    this.arm = new Button("Arm", {
      tips,
      press: () => link.send({ t: this._armed ? "disarm" : "arm" }),
      kind: "primary",
    });
    this.control = new Button("Take control", {
      tips,
      press: () => this._pressControl(),
      kind: "primary",
    });
    this._fold = new Button("Fold", { tips, press: fold, kind: "quiet" });
    tips.attach(this._linkStatus, () => this._explainLink());
    this.level = el("span", { class: "slot" });
    this.element = el(
      "header",
      { class: "bar surface" },
      el("span", { class: "group robot" }, this._robots),
      el("span", { class: "group state" }, this._mode, this.arm.element),
      el("span", { class: "group driver" }, this._who, this.control.element),
      el("span", { class: "group facts" }, this._linkStatus, this._battery),
      el("span", { class: "group last" }, this.level, this._fold.element),
    );
    for (const type of /** @type {const} */ (["state", "welcome", "robot", "beat", "down"]))
      link.on(type, () => this._draw());
    this._draw();
  }

  /** What is asked for together with control. */
  wish() {
    const trip = this._link.roundTripMs();
    // A far link is given more time, at the price of a lower speed that the robot sets.
    return { max_age_s: trip !== null && trip > FAR_MS ? (2 * trip + 100) / 1000 : null };
  }

  /**
   * Acquire control of the robot that is watched; with a reason, also from who has it.
   * @param {string | null} reason
   */
  take(reason = null) {
    const over = reason === null ? {} : { take_over: true, reason };
    this._link.send({ t: "lease", op: "acquire", ...this.wish(), ...over });
  }

  /** @param {boolean} folded */
  showFolded(folded) {
    this._fold.become(
      folded ? "Unfold" : "Fold",
      folded ? "Show the stick and the figures" : "Hide the stick and the figures",
    );
    setAttribute(this._fold.button, "aria-expanded", String(!folded));
  }

  _pressControl() {
    const { you, status } = known(this._link.state);
    if (you) this._link.send({ t: "lease", op: "release" });
    else if (this._handOver().waits) this._handOver().withdraw();
    else if (status.lease.holder !== null) this._handOver().ask();
    else this.take();
  }

  _choose() {
    this._link.choose(this._robots.value);
  }

  _draw() {
    const link = this._link;
    const stale = link.isStale();
    const status = link.state?.status ?? null;
    this._drawRobots();
    this._drawMode(stale || status === null ? null : status.mode);
    this._drawControl(status);
    this._drawLink();
    const volts = status?.hardware.battery_v;
    this._battery.hidden = typeof volts !== "number";
    if (typeof volts === "number") setText(this._volts, `${fixed(volts, 1)} V`);
  }

  _drawRobots() {
    const robots = this._link.welcome?.robots ?? [];
    const shown = [...this._robots.options].map((option) => option.value);
    if (robots.map(({ id }) => id).join() !== shown.join()) {
      this._robots.replaceChildren(
        ...robots.map(({ id, title }) => el("option", { value: id, title }, id)),
      );
    }
    setAttribute(this._robots, "data-single", robots.length > 1 ? null : "");
    this._robots.hidden = robots.length === 0;
    if (this._link.robot !== null) this._robots.value = this._link.robot.id;
  }

  /** @param {string | null} mode */
  _drawMode(mode) {
    const word = mode ?? (this._link.robot === null ? "no robot" : "no signal");
    if (mode !== this._shownMode || this._modeIcon.childElementCount === 0) {
      this._shownMode = mode;
      this._modeIcon.replaceChildren(icon(mode ?? "none"));
    }
    setText(this._modeWord, word.toUpperCase());
    setAttribute(this._mode, "data-mode", mode ?? "unknown");
    this._armed = mode !== null && !AT_REST.has(mode);
    this.arm.become(
      this._armed ? "Disarm" : "Arm",
      this._armed ? "Spin the wheels down" : "Check neutral tilt, then spin the wheels up",
    );
    this.arm.allow(this._armed ? notDisarm(this._link) : notArm(this._link));
    setAttribute(this.arm.button, "data-quiet", this._armed ? "" : null);
  }

  /** @param {Status | null} status */
  _drawControl(status) {
    const you = this._link.state?.you ?? false;
    const holder = status?.lease.holder ?? null;
    const kept = status?.lease.reserved_for ?? null;
    const waits = this._handOver().waits;
    setText(this._name, you ? "you" : (holder ?? (kept === null ? "no operator" : "kept for")));
    setText(this._does, you ? "drive" : ((holder === null ? kept : null) ?? "drives"));
    setAttribute(this._who, "title", you ? null : holder);
    /** @type {[string, string]} */
    const [label, tip] = you
      ? ["Release control", "Give control back; the robot comes to rest"]
      : waits
        ? ["Withdraw request", "Ask for control no longer"]
        : holder === null
          ? ["Take control", "Ask for the right to drive; one at a time has it"]
          : ["Ask for control", `${holder} drives, is asked, and can hand over or keep control`];
    this.control.become(label, tip);
    this.control.allow(notTake(this._link));
    setAttribute(this.control.button, "data-quiet", you || waits ? "" : null);
  }

  _drawLink() {
    const lost = this._link.isStale();
    const trip = this._link.roundTripMs();
    const { grade } = this._quality();
    if (grade !== this._shownGrade) {
      this._shownGrade = grade;
      this._dot.replaceChildren(icon(grade));
    }
    setAttribute(this._linkStatus, "data-grade", grade);
    setText(this._grade, WORDS[grade]);
    setText(this._ms, lost ? "no link" : `${trip === null ? "–" : Math.round(trip)} ms`);
  }

  _quality() {
    const link = this._link;
    return quality({
      tripMs: link.isStale() ? null : link.roundTripMs(),
      jitterMs: link.jitterMs(),
      lost: link.lost,
      allowedMs: 1000 * (link.state?.status.limits.max_command_age_s ?? 0),
    });
  }

  _explainLink() {
    const { connected, pageMs, pageJitterMs, lost, state } = this._link;
    if (!connected) return "No connection to the dashboard.";
    const { used } = this._quality();
    const allowed = 1000 * (state?.status.limits.max_command_age_s ?? NaN);
    return (
      `There and back: page to dashboard ${fixed(pageMs, 0)} ms, dashboard to robot ${fixed(state?.robot_ms, 0)} ms. ` +
      `One in twenty takes ${fixed(pageJitterMs, 0)} and ${fixed(state?.robot_jitter_ms, 0)} ms longer. ` +
      `That is ${fixed(100 * (used ?? NaN), 0)} % of the ${fixed(allowed, 0)} ms that a command may be old. ` +
      `${fixed(100 * lost, 0)} % of the states did not come.`
    );
  }
}
