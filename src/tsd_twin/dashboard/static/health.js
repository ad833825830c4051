// How well everything works, in figures, and what has happened.

import { el, isVisible, setText } from "./dom.js";
import { fixed } from "./format.js";
import { known } from "./link.js";

/** @type {Record<string, string>} */
const REASONS = {
  stale: "too old",
  lease: "no lease",
  order: "out of order",
  nonfinite: "not finite",
  key: "wrong key",
  shape: "unreadable",
  frame: "other frame",
  quaternion: "not upright",
  future: "from the future",
  old: "too old",
  flood: "too many",
  far: "far from the estimate",
};
const LINES = 40;

/** @typedef {Record<string, Record<string, string>>} Sections Rows by the title of their table. */

export class Health {
  /** @param {Link} link @param {ShadowRoot} place @param {AbortSignal} signal */
  constructor(link, place, signal) {
    this._link = link;
    this._values = new Map();
    this._table = el("div.tables");
    this._log = el("ol.log", {
      role: "log",
      "aria-live": "polite",
      "aria-label": "Events",
      tabindex: "0",
    });
    place.append(this._table, el("div.head", el("strong", "Events")), this._log);
    link.on("state", () => isVisible(place.host) && this._show(), signal);
    link.on("event", (event) => this._add(event), signal);
    link.on("robot", () => this._log.replaceChildren(), signal);
    for (const event of link.history) this._add(event);
  }

  /** @param {RobotEvent} event */
  _add({ kind, text, robot_s: seconds }) {
    const time = el("span.value.time", seconds > 0 ? `${fixed(seconds, 1)} s` : "now");
    this._log.prepend(el("li", { "data-kind": kind }, time, el("span", text)));
    this._log.children[LINES]?.remove();
  }

  _show() {
    const { status, age_ms: age, robot_ms: robot } = known(this._link.state);
    const { loop, command, lease, limits, consistency: conflict, pose_sensor: outside } = status;
    const suspect = conflict.suspect === null ? "none" : called(conflict.suspect);
    const wheels = {
      suspect,
      residual: `${fixed(1000 * conflict.residual_mps, 1)} mm/s`,
      evidence: times(conflict.level),
      ...Object.fromEntries(
        Object.entries(conflict.explained).map(([name, level]) => [
          `· ${called(name)} explains`,
          times(level),
        ]),
      ),
    };
    const sections = {
      Conflict: wheels,
      Loop: {
        rate: `${fixed(loop.hz, 1)} Hz`,
        "jitter p99": `${fixed(loop.jitter_p99_ms, 2)} ms`,
        overruns: String(loop.overruns),
      },
      Link: {
        "page to dashboard": `${fixed(this._link.pageMs, 1)} ms`,
        "dashboard to robot": `${fixed(robot, 1)} ms`,
        jitter: `${fixed(this._link.jitterMs(), 1)} ms`,
        "states lost": `${fixed(100 * this._link.lost, 1)} %`,
        "age of the picture": `${fixed(age, 0)} ms`,
      },
      Commands: {
        accepted: String(command.accepted),
        "there and back": milliseconds(command.echo_s),
        "age of the newest": (command.age_s ?? 0) < 10 ? milliseconds(command.age_s) : "over 10 s",
        ...lost(command.dropped),
      },
      Control: {
        holder: lease.holder ?? "none",
        "lease ends in": lease.holder === null ? "–" : `${fixed(lease.remaining_s, 1)} s`,
        "speed limit": `${fixed(limits.speed_mps, 2)} m/s`,
        "let through": `${fixed(100 * limits.applied, 0)} %`,
        "oldest command": milliseconds(limits.max_command_age_s),
        "stops without link in": `${fixed(limits.stop_allowance_m, 2)} m`,
      },
      ...(outside ? { "Outside poses": seen(outside) } : {}),
      ...tables("Hardware", status.hardware),
    };
    const shape = JSON.stringify(
      Object.entries(sections).map(([title, rows]) => [title, Object.keys(rows)]),
    );
    if (shape !== this._shape) this._build(shape, sections);
    for (const [title, rows] of Object.entries(sections)) {
      for (const [name, value] of Object.entries(rows))
        setText(this._values.get(`${title} ${name}`), value);
    }
    for (const name of Object.keys(wheels)) {
      const accused = name === "suspect" || name.startsWith(`· ${suspect} `);
      const row = this._values.get(`Conflict ${name}`).parentElement;
      row.toggleAttribute("data-suspect", accused && conflict.suspect !== null);
    }
  }

  /** @param {string} shape @param {Sections} sections */
  _build(shape, sections) {
    this._shape = shape;
    this._values.clear();
    this._table.replaceChildren(
      ...Object.entries(sections).map(([title, rows]) => this._section(title, Object.keys(rows))),
    );
  }

  /** @param {string} title @param {string[]} names */
  _section(title, names) {
    const lines = names.map((name) => {
      const cell = el("td.value");
      this._values.set(`${title} ${name}`, cell);
      return el("tr", el("th", { scope: "row" }, name), cell);
    });
    return el("table", el("caption", title), el("tbody", ...lines));
  }
}

/** "module2" as a person says it. @param {string} name */
function called(name) {
  return name.replace(
    /^(.)(.*?)(\d+)$/,
    (_, first, rest, number) => `${first.toUpperCase()}${rest} ${number}`,
  );
}

/**
 * How much more than noise would ever be, in words that stay as wide as they are.
 * @param {number} level
 */
function times(level) {
  return `${fixed(level, level < 10 ? 2 : 0)} of the limit`;
}

/** Pose sensor of the robot, such as a camera. @param {PoseSensorStatus} sensor */
function seen({ hz, late_s: late, used, found, dropped }) {
  return {
    "in use": hz > 0 ? `${fixed(hz, 0)} Hz, ${fixed(1000 * (late ?? NaN), 0)} ms late` : "none now",
    used: String(used),
    "found elsewhere": String(found),
    ...lost(dropped),
  };
}

/** @param {Record<string, number>} dropped */
function lost(dropped) {
  const counts = Object.entries(dropped);
  return {
    dropped: String(counts.reduce((sum, [, count]) => sum + count, 0)),
    ...Object.fromEntries(
      counts
        .filter(([, count]) => count > 0)
        .map(([why, count]) => [`· ${REASONS[why] ?? why}`, String(count)]),
    ),
  };
}

/** @param {number | null} seconds */
function milliseconds(seconds) {
  return seconds === null ? "–" : `${fixed(1000 * seconds, 0)} ms`;
}

/**
 * Return what a robot says of its hardware: figures in one table, each group in one of its own.
 * @param {string} title
 * @param {Hardware} facts
 * @returns {Sections}
 */
function tables(title, facts) {
  const rows = Object.entries(facts).map(([name, value]) => [name.replaceAll("_", " "), value]);
  const groups = rows.filter(([, value]) => isGroup(value));
  const figures = rows.filter(([, value]) => !isGroup(value));
  return Object.assign(
    { [title]: Object.fromEntries(figures.map(([name, value]) => [name, written(value)])) },
    ...groups.map(([name, value]) => tables(`${title}: ${name}`, /** @type {Hardware} */ (value))),
  );
}

/** @param {unknown} value @returns {value is Hardware} */
function isGroup(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** @param {unknown} value @param {number} [digits] @returns {string} */
function written(value, digits = decimals(value)) {
  if (Array.isArray(value)) {
    const most = Math.max(0, ...value.map(decimals)); // As many for all of them.
    return value.map((each) => written(each, most)).join(", ");
  }
  if (typeof value === "number") return fixed(value, digits);
  if (typeof value === "boolean") return value ? "yes" : "no";
  return value === null ? "–" : String(value);
}

// How many decimals a number needs, two at most.
/** @param {unknown} value */
function decimals(value) {
  if (typeof value !== "number") return 0;
  return [0, 1].find((digits) => Math.abs(value - Number(value.toFixed(digits))) < 0.005) ?? 2;
}
