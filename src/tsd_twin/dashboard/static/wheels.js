// One bar per rolling wheel: measured speed, setpoint and unexplained part.

import { ConsistencyMeter } from "./consistency.js";
import { el, isVisible, legend, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { assertDefined } from "./link.js";

export class Wheels {
  /** @param {Link} link @param {HTMLElement} place @param {AbortSignal} signal */
  constructor(link, place, signal) {
    this._link = link;
    this._list = new WheelList(link);
    this._meter = new ConsistencyMeter("Wheel");
    this._difference = new EstimateDifference(link);
    place.append(this._list.element, ...this._meter.elements, this._difference.element);
    link.on("state", () => isVisible(place) && this._show(), signal);
  }

  _show() {
    const { consistency } = assertDefined(this._link.state).status;
    const { wheels } = assertDefined(this._link.robot);
    this._list.show(consistency.suspect);
    this._difference.show();
    const isDetermined = wheels.length < 4;
    const agreement = isDetermined
      ? "Three wheels cannot contradict one another."
      : "The wheels agree.";
    this._meter.show(consistency, wheels, agreement);
  }
}

/** Row per wheel, with a bar from the centre; right is forward. */
export class WheelList {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._built = null;
    /** @type {((wheel: WheelState, suspect: boolean) => void)[]} */
    this._rows = [];
    this._bars = el("div.wheels");
    this.element = el("div", legend("tick", "right is forward"), this._bars);
  }

  /** @param {string | null} suspect */
  show(suspect) {
    const [robot, state] = [assertDefined(this._link.robot), assertDefined(this._link.state)];
    if (this._built !== robot) this._build(robot);
    state.wheels.forEach((wheel, i) => this._rows[i]?.(wheel, robot.wheels[i] === suspect));
  }

  /** @param {RobotInfo} robot */
  _build(robot) {
    this._built = robot;
    const rows = robot.wheels.map((_, i) => row(i + 1, assertDefined(robot.max_rpm)));
    this._rows = rows.map(({ show }) => show);
    this._bars.replaceChildren(...rows.map(({ element }) => element));
  }
}

/** Difference of the second estimate, for robots that have one. */
export class EstimateDifference {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._text = el("p.verdict");
    const mark = el("i.cage", { "aria-hidden": "true" });
    const head = el("div.head", mark, el("strong", "Other estimate"));
    this.element = el("div.difference", { hidden: true }, head, this._text);
  }

  show() {
    const { alternative_estimate: source } = assertDefined(this._link.robot);
    const { estimate_difference: difference, pose } = assertDefined(this._link.state);
    this.element.hidden = source === null || difference === null;
    if (source === null || difference === null) return;
    const distance = pose === null ? "" : `${fixed(difference.metres, 3)} m and `; // Not for spheres.
    setText(
      this._text,
      `By its ${source}: ${distance}${fixed(difference.degrees, 1)}° from this one.`,
    );
  }
}

/** @param {number} number @param {number} maxRpm */
function row(number, maxRpm) {
  const bar = el("div.bar");
  const tick = el("div.tick");
  const speed = el("span.value");
  const track = el(
    "div.speed",
    { role: "meter", "aria-label": `Speed of wheel ${number}` },
    { "aria-valuemin": -maxRpm, "aria-valuemax": maxRpm, "aria-valuenow": 0 },
    bar,
    tick,
  );
  const element = el(
    "section.wheel",
    { "aria-label": `Wheel ${number}` },
    el("strong", `Wheel ${number}`),
    el("span.figure", speed, el("span.unit", " rpm")),
    track,
  );
  /** @type {(wheel: WheelState, suspect: boolean) => void} */
  const show = ({ rpm, rpm_setpoint: set }, suspect) => {
    setText(speed, fixed(rpm, 0));
    bar.style.transform = `scaleX(${clamp(rpm / maxRpm).toFixed(4)})`;
    tick.style.left = `${(50 + 50 * clamp(set / maxRpm)).toFixed(2)}%`;
    setAttribute(track, "aria-valuenow", Math.round(rpm));
    element.toggleAttribute("data-suspect", suspect);
  };
  return { element, show };
}

/** @param {number} share */
function clamp(share) {
  return Math.max(-1, Math.min(1, share));
}
