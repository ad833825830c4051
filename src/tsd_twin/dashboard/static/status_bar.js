// Status bar: robot, mode, lease holder and link quality.

import { Button, tooltip } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { kindOf } from "./kinds.js";
import { assertDefined } from "./link.js";
import {
  armBlockedReason,
  notConnected,
  disarmBlockedReason,
  acquireBlockedReason,
} from "./blocked_reasons.js";
import { nameOf } from "./reasons.js";

const AT_REST = new Set(["disarmed", "stopped", "fault"]);

export class StatusBar {
  /** @param {Link} link @param {HandOver} handOver @param {() => void} fold */
  constructor(link, handOver, fold) {
    this._link = link;
    this._handOver = handOver;
    /** @type {boolean} */
    this._armed = false;
    this._shownMode = "";
    this._shownGrade = "";
    this._robots = el("select", { "aria-label": "Robot" });
    this._robots.addEventListener("change", () => link.choose(this._robots.value));
    this._modeIcon = el("span.shape");
    this._modeWord = el("span");
    const modeAttributes = { role: "status", "aria-label": "Mode" };
    this._mode = el("span.mode", modeAttributes, this._modeIcon, this._modeWord);
    this._name = el("span.name");
    this._does = el("span");
    this._who = el("span.who", this._name, " ", this._does);
    this._dot = el("span.shape");
    this._grade = el("span.word");
    this._ms = el("span.number");
    this._linkStatus = el(
      "span.link",
      { role: "status", "aria-live": "off", "aria-label": "Link", tabindex: "0" },
      this._dot,
      this._grade,
      this._ms,
    );
    this._volts = el("span.number");
    this._battery = el("span.battery", { hidden: true }, icon("battery"), this._volts);
    this.arm = new Button("Arm", () => link.send({ t: this._armed ? "disarm" : "arm" }), {
      kind: "primary",
    });
    const press = () => this._pressControl();
    this.control = new Button("Take control", press, { kind: "primary" });
    this._fold = new Button("Hide controls", fold, { kind: "quiet" });
    tooltip.attach(this._linkStatus, () => this._explainLink());
    this.level = el("span.slot");
    this.element = el(
      "header.bar.surface",
      el("span.group.robot", this._robots),
      el("span.group.state", this._mode, this.arm.element),
      el("span.group.driver", this._who, this.control.element),
      el("span.group.facts", this._linkStatus, this._battery),
      el("span.group.last", this.level, this._fold.element),
    );
    link.on(["state", "welcome", "robot", "beat", "down"], () => this._draw());
    this._draw();
  }

  /** @param {boolean} folded */
  showFolded(folded) {
    this._fold.setLabel(folded ? "Show controls" : "Hide controls", "Stick, turn and figures");
    setAttribute(this._fold.button, "aria-expanded", String(!folded));
  }

  _pressControl() {
    const { has_control: you, status } = assertDefined(this._link.state);
    if (you) this._handOver.release();
    else if (this._handOver.waits) this._handOver.withdraw();
    else if (status.lease.holder !== null) this._handOver.ask();
    else this._handOver.acquire();
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
    if (typeof volts === "number") setText(this._volts, `${fixed(stale ? null : volts, 1)} V`);
  }

  _drawRobots() {
    const robots = this._link.welcome?.robots ?? [];
    const shown = [...this._robots.options].map((option) => option.value);
    if (robots.map(({ id }) => id).join() !== shown.join()) {
      this._robots.replaceChildren(
        ...robots.map(({ id, title }) => el("option", { value: id, title }, id)),
      );
    }
    this._robots.toggleAttribute("data-single", robots.length <= 1);
    this._robots.hidden = robots.length === 0;
    if (this._link.robot !== null) this._robots.value = this._link.robot.id;
  }

  /** @param {string | null} mode */
  _drawMode(mode) {
    const without = this._link.robot === null ? "no robot" : "no signal";
    const word = mode ?? (this._link.isLoading() ? "connecting" : without);
    const shape = mode ?? "none";
    if (shape !== this._shownMode) this._modeIcon.replaceChildren(icon(shape));
    this._shownMode = shape;
    setText(this._modeWord, word.toUpperCase());
    setAttribute(this._mode, "data-mode", mode ?? "unknown");
    this._armed = mode !== null && !AT_REST.has(mode);
    const { robot, welcome } = this._link;
    const { arm, disarm } = kindOf(robot);
    const several = (welcome?.robots.length ?? 0) > 1;
    const name = several && robot !== null ? ` ${robot.id}` : "";
    this.arm.setLabel(`${this._armed ? "Disarm" : "Arm"}${name}`, this._armed ? disarm : arm);
    this.arm.setDisabledReason(
      this._armed ? disarmBlockedReason(this._link) : armBlockedReason(this._link),
    );
    this.arm.button.toggleAttribute("data-quiet", this._armed);
  }

  /** @param {Status | null} status */
  _drawControl(status) {
    const you = this._link.state?.has_control ?? false;
    const holder = status?.lease.holder ?? null;
    const kept = status?.lease.reserved_for ?? null;
    const waits = this._handOver.waits;
    const [name, does] = you
      ? ["you", "drive"]
      : holder !== null
        ? [nameOf(holder), "drives"]
        : kept !== null
          ? ["kept for", nameOf(kept)]
          : ["control", "is free"];
    setText(this._name, name);
    setText(this._does, does);
    setAttribute(this._who, "title", you ? null : holder);
    this._who.toggleAttribute("data-you", you);
    if (you) this.control.setLabel("Release control", "The robot comes to rest");
    else if (waits) this.control.setLabel("Withdraw request", "Ask for control no longer");
    else if (holder === null)
      this.control.setLabel("Take control", "One operator drives at a time");
    else this.control.setLabel("Ask for control", `${name} drives, and can hand control over`);
    this.control.setDisabledReason(acquireBlockedReason(this._link));
    this.control.button.toggleAttribute("data-quiet", you || waits);
  }

  _drawLink() {
    const lost = this._link.isStale();
    const trip = this._link.roundTripMs();
    const { grade } = this._link.quality();
    if (grade !== this._shownGrade) this._dot.replaceChildren(icon(grade));
    this._shownGrade = grade;
    setAttribute(this._linkStatus, "data-grade", grade);
    setText(this._grade, grade === "none" ? "" : grade);
    const none = this._link.isLoading() ? "–" : "no link";
    setText(this._ms, lost ? none : `${trip === null ? "–" : Math.round(trip)} ms`);
  }

  _explainLink() {
    const { connected, pageMs, pageJitterMs, lost, state } = this._link;
    if (!connected) return `${notConnected(this._link)}.`;
    const { used } = this._link.quality();
    const allowed = 1000 * (state?.status.limits.max_command_age_s ?? NaN);
    return (
      `Round trip: page to dashboard ${fixed(pageMs, 0)} ms, dashboard to robot ${fixed(state?.rtt_ms, 0)} ms; ` +
      `jitter ${fixed(pageJitterMs, 0)} and ${fixed(state?.rtt_jitter_ms, 0)} ms. ` +
      `That is ${fixed(100 * (used ?? NaN), 0)} % of the ${fixed(allowed, 0)} ms that a command may be old. ` +
      `States lost: ${fixed(100 * lost, 0)} %.`
    );
  }
}
