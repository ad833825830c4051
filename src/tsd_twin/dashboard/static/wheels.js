// A bar for each wheel that rolls: how fast it turns, how fast it should, and what no motion explains.

import { ConsistencyMeter } from "./consistency.js";
import { el, isVisible, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { known } from "./link.js";

export class Wheels {
  /** @param {Link} link @param {HTMLElement} place */
  constructor(link, place) {
    this._link = link;
    this._list = new WheelList(link);
    this._conflict = new ConsistencyMeter("Wheel");
    this._apart = new EstimateDifference(link);
    place.append(this._list.element, ...this._conflict.elements, this._apart.element);
    this._open = true;
    link.on("state", () => this._open && isVisible(place) && this._show());
  }

  close() {
    this._open = false;
  }

  _show() {
    const { consistency: conflict } = known(this._link.state).status;
    const { wheels } = known(this._link.robot);
    this._list.show(conflict.suspect);
    this._apart.show();
    const alone = wheels.length < 4;
    const peace = alone ? "Three wheels cannot contradict one another." : "The wheels agree.";
    this._conflict.show(conflict, wheels, peace);
  }
}

/** A row for each wheel, with a bar from the middle: to the right it turns forward. */
export class WheelList {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    /** @type {RobotInfo | null} */
    this._built = null;
    /** @type {((wheel: WheelState, suspect: boolean) => void)[]} */
    this._rows = [];
    this._bars = el("div", { class: "wheels" });
    this.element = el(
      "div",
      {},
      el(
        "p",
        { class: "key" },
        el("i", { class: "tick" }),
        "set-point",
        el("i", { class: "dot" }),
        "measured",
        el("span", { class: "muted" }, "right is forward"),
      ),
      this._bars,
    );
  }

  /** @param {string | null} suspect */
  show(suspect) {
    const [robot, state] = [known(this._link.robot), known(this._link.state)];
    if (this._built !== robot) this._build(robot);
    state.wheels.forEach((wheel, i) => this._rows[i]?.(wheel, robot.wheels[i] === suspect));
  }

  /** @param {RobotInfo} robot */
  _build(robot) {
    this._built = robot;
    const rows = robot.wheels.map((_, i) => row(i + 1, known(robot.max_rpm)));
    this._rows = rows.map(({ show }) => show);
    this._bars.replaceChildren(...rows.map(({ element }) => element));
  }
}

/** How far the other estimate is off, of robots that have two. */
export class EstimateDifference {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._text = el("p", { class: "verdict" });
    this.element = el(
      "div",
      { class: "apart", hidden: true },
      el(
        "div",
        { class: "head" },
        el("i", { class: "cage", "aria-hidden": "true" }),
        el("strong", {}, "Other estimate"),
      ),
      this._text,
    );
  }

  show() {
    const [robot, state] = [known(this._link.robot), known(this._link.state)];
    this.element.hidden = !robot.other || !state.apart;
    if (!robot.other || !state.apart) return;
    const { metres, degrees } = state.apart;
    const by = robot.space === "ball" ? "" : `${fixed(metres, 3)} m and `;
    setText(this._text, `By its ${robot.other} it is ${by}${fixed(degrees, 1)}° elsewhere.`);
  }
}

/** @param {number} number @param {number} most */
function row(number, most) {
  const bar = el("div", { class: "bar" });
  const tick = el("div", { class: "tick" });
  const speed = el("span", { class: "value" });
  const track = el(
    "div",
    {
      class: "speed",
      role: "meter",
      "aria-label": `Speed of wheel ${number}`,
      "aria-valuemin": -most,
      "aria-valuemax": most,
    },
    bar,
    tick,
  );
  const element = el(
    "section",
    { class: "wheel", "aria-label": `Wheel ${number}` },
    el("strong", {}, `Wheel ${number}`),
    el("span", { class: "figure" }, speed, el("span", { class: "unit" }, " rpm")),
    track,
  );
  /** @type {(wheel: WheelState, suspect: boolean) => void} */
  const show = ({ rpm, set_rpm: set }, suspect) => {
    setText(speed, fixed(rpm, 0));
    bar.style.transform = `scaleX(${clamp(rpm / most).toFixed(4)})`;
    tick.style.left = `${(50 + 50 * clamp(set / most)).toFixed(2)}%`;
    setAttribute(track, "aria-valuenow", Math.round(rpm));
    setAttribute(element, "data-suspect", suspect ? "" : null);
  };
  return { element, show };
}

/** @param {number} share */
function clamp(share) {
  return Math.max(-1, Math.min(1, share));
}
