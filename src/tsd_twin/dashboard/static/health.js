// Health tab: quality figures and event log.

import { el, isVisible, setText } from "./dom.js";
import { clock, fixed } from "./format.js";
import { sentence, words } from "./reasons.js";
import { assertDefined } from "./link.js";
import { quantityOf } from "./plot_fields.js";

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
const SHADOW = "Measured minus simulated";
const OUTSIDE = "outside";

/** @typedef {Record<string, Record<string, string>>} Sections Rows by the title of their table. */

export class Health {
  /** @param {Link} link @param {ShadowRoot} place @param {AbortSignal} signal */
  constructor(link, place, signal) {
    this._link = link;
    /** @type {Map<string, HTMLElement>} */
    this._cells = new Map(); // By table title and row name.
    this._tables = el("div.tables");
    this._drifts = el("div.drifts", { role: "status" });
    this._isShown = false;
    const attributes = { role: "log", "aria-live": "polite", "aria-label": "Events", tabindex: 0 };
    this._log = el("ol");
    const log = el("div.log", attributes, this._log);
    place.append(this._drifts, this._tables, el("div.head", el("strong", "Events")), log);
    link.on("state", (state) => this._showIf(isVisible(place.host), state), signal);
    link.on("up", () => (this._isShown = false), signal);
    signal.addEventListener("abort", () => this._request(false));
    link.on("event", () => this._add(assertDefined(link.history.at(-1) ?? null)), signal);
    link.on("robot", () => this._log.replaceChildren(), signal);
    for (const event of link.history) this._add(event);
  }

  /** @param {RobotEvent & { atMs: number }} event */
  _add({ kind, why, robot_s: seconds, atMs }) {
    const title = seconds > 0 ? `${fixed(seconds, 1)} s on the clock of the robot` : null;
    const time = el("span.value.time", { title }, clock(atMs));
    this._log.prepend(el("li", { "data-kind": kind }, time, el("span", sentence(why))));
    this._log.children[LINES]?.remove();
  }

  /**
   * Request the shadow twin only while it is shown, because the server compares only then.
   * @param {boolean} isOn
   */
  _request(isOn) {
    if (isOn !== this._isShown) this._link.send({ t: "shadow", on: isOn });
    this._isShown = isOn;
  }

  /** @param {boolean} isOn @param {RobotState} state */
  _showIf(isOn, state) {
    this._request(isOn);
    if (isOn) this._show(state);
  }

  /** @param {RobotState} state */
  _show(state) {
    const texts = state.shadow?.drifts.map(({ text }) => text) ?? [];
    if (texts.join() !== [...this._drifts.children].map((each) => each.textContent).join()) {
      this._drifts.replaceChildren(...texts.map((text) => el("p", text)));
    }
    const suspect = called(state.status.consistency.suspect);
    const tables = Object.entries(sections(this._link, state));
    const keys = tables.flatMap(([title, rows]) =>
      Object.keys(rows).map((row) => `${title} ${row}`),
    );
    if (keys.join() !== [...this._cells.keys()].join()) {
      this._cells.clear();
      this._tables.replaceChildren(...tables.map(([title, rows]) => this._table(title, rows)));
    }
    for (const [title, rows] of tables) {
      for (const [name, value] of Object.entries(rows)) {
        const cell = assertDefined(this._cells.get(`${title} ${name}`) ?? null);
        setText(cell, value);
        const isAccused = name === "suspect" || name.startsWith(`· ${suspect} `);
        const isOutside = title === SHADOW && value.endsWith(OUTSIDE);
        const isMarked = isOutside || (title === "Consistency" && suspect !== "none" && isAccused);
        cell.parentElement?.toggleAttribute("data-suspect", isMarked);
      }
    }
  }

  /** @param {string} title @param {Record<string, string>} rows */
  _table(title, rows) {
    const lines = Object.keys(rows).map((name) => {
      const cell = el("td.value");
      this._cells.set(`${title} ${name}`, cell);
      return el("tr", el("th", { scope: "row" }, name), cell);
    });
    return el("table", el("caption", title), el("tbody", ...lines));
  }
}

/** @type {(link: Link, state: RobotState) => Sections} */
function sections(link, { status, age_ms: age, rtt_ms: robot, shadow }) {
  const { loop, command, lease, limits, consistency, pose_sensor: poses, learned } = status;
  const explained = Object.entries(consistency.contributions).map(([name, level]) => [
    `· ${called(name)} explains`,
    times(level),
  ]);
  const tested = {
    suspect: called(consistency.suspect),
    residual: `${fixed(1000 * consistency.residual_mps, 1)} mm/s`,
    evidence: times(consistency.level),
    ...Object.fromEntries(explained),
  };
  return {
    Consistency: link.robot?.not_promised.length ? { test: "not available" } : tested,
    ...(shadow ? { [SHADOW]: compared(shadow) } : {}),
    Loop: {
      rate: `${fixed(loop.hz, 1)} Hz`,
      "jitter p99": `${fixed(loop.jitter_p99_ms, 2)} ms`,
      overruns: String(loop.overruns),
    },
    Link: {
      "page to dashboard": `${fixed(link.pageMs, 1)} ms`,
      "dashboard to robot": `${fixed(robot, 1)} ms`,
      jitter: `${fixed(link.jitterMs(), 1)} ms`,
      "states lost": `${fixed(100 * link.lost, 1)} %`,
      "age of the state": `${fixed(age, 0)} ms`,
    },
    Page: {
      "scene drawn by": window.tsd.lowDetail ? "the processor, slowly" : "the graphics card",
    },
    Commands: {
      accepted: String(command.accepted),
      "round trip": milliseconds(command.echo_s),
      "newest, age": (command.age_s ?? 0) < 10 ? milliseconds(command.age_s) : "over 10 s",
      ...lost(command.dropped),
    },
    Control: {
      holder: lease.holder ?? "none",
      "lease ends in": lease.holder === null ? "–" : `${fixed(lease.remaining_s, 1)} s`,
      "speed limit": `${fixed(limits.speed_mps, 2)} m/s${(limits.why ?? []).map((why) => `: ${words(why)}`).join("")}`,
      "applied of the command": `${fixed(100 * limits.applied, 0)} %`,
      "permitted command age": milliseconds(limits.max_command_age_s),
      "stop distance without link": link.robot?.not_promised.length
        ? "not promised"
        : `${fixed(limits.stop_allowance_m, 2)} m`,
    },
    ...(poses ? { "Outside poses": seen(poses) } : {}),
    ...(learned ? { "Learned while driving": errors(learned) } : {}),
    ...tables("Hardware", status.hardware),
  };
}

/** Format a name such as "module2" for reading. @param {string | null} name */
function called(name) {
  const [, first, rest, number] = /^(.)(.*?)(\d+)$/.exec(name ?? "") ?? [];
  return number === undefined ? (name ?? "none") : `${first.toUpperCase()}${rest} ${number}`;
}

/**
 * Rows of the shadow twin comparison; values outside their band are marked.
 * @param {ShadowReport} shadow
 */
function compared({ compared_s: seconds, joints, pose, note }) {
  const rows = joints.map(({ name, unit, measured, simulated, band, inside }) => [
    name.replaceAll("_", " "),
    measured === null ? "not measured" : within(measured - simulated, band, unit, inside),
  ]);
  const motion = pose?.names.map((name, i) => {
    const inside = Math.abs(pose.difference[i]) <= pose.band[i];
    return [`motion ${name}`, within(pose.difference[i], pose.band[i], pose.units[i], inside)];
  });
  return {
    ...Object.fromEntries([...rows, ...(motion ?? [])]),
    "compared for": `${fixed(seconds, 0)} s`,
    ...(note ? { note } : {}),
  };
}

/** @param {number} difference @param {number} band @param {string} unit @param {boolean} inside */
function within(difference, band, unit, inside) {
  const decimals = unit === "°" ? 2 : 0;
  const text = `${fixed(difference, decimals)} of ±${fixed(band, decimals)} ${unit}`;
  return inside ? text : `${text}, ${OUTSIDE}`;
}

/** Format a level relative to the noise limit. @param {number} level */
function times(level) {
  return `${fixed(level, level < 10 ? 2 : 0)} of the limit`;
}

/** Rows of the pose sensor, such as a camera. @param {PoseSensorStatus} sensor */
function seen({ hz, latency_s: late, used, found, dropped }) {
  return {
    "in use": hz > 0 ? `${fixed(hz, 0)} Hz, ${fixed(1000 * (late ?? NaN), 0)} ms late` : "none now",
    used: String(used),
    "too far off": String(found),
    ...lost(dropped),
  };
}

/** @type {[string, number, number, string][]} End of a name; factor, digits and unit of the page. */
const UNITS = [
  ["_rad_per_s", 180 / Math.PI, 3, "°/s"],
  ["_rad", 180 / Math.PI, 3, "°"],
  ["_mps", 1000, 2, "mm/s"],
  ["_share", 100, 2, "%"],
  ["_s", 1000, 1, "ms"],
];

/**
 * Rows of the biases, each with its standard deviation.
 * @param {Record<string, BiasStatus>} learned
 */
function errors(learned) {
  const rows = Object.entries(learned).map(([name, { value, sigma }]) => {
    const [end, factor, digits, unit] = assertDefined(
      UNITS.find(([last]) => name.endsWith(last)) ?? null,
    );
    const figures = [value, sigma].map((figure) => fixed(factor * figure, digits));
    return [name.slice(0, -end.length).replaceAll("_", " "), `${figures.join(" ± ")} ${unit}`];
  });
  return Object.fromEntries(rows);
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
 * Convert hardware facts to tables: values in one table, each group in a separate one.
 * @param {string} title @param {Hardware} facts
 * @returns {Sections}
 */
function tables(title, facts) {
  const spaced = (/** @type {string} */ name) => name.replaceAll("_", " ");
  const rows = Object.entries(facts);
  const figures = rows
    .filter(([, value]) => !isGroup(value))
    .map(([name, value]) => {
      const { quantity, unit = "" } = quantityOf(name);
      return [spaced(quantity), `${written(value)} ${unit}`.trimEnd()];
    });
  const groups = rows.filter(([, value]) => isGroup(value));
  return Object.assign(
    { [title]: Object.fromEntries(figures) },
    ...groups.map(([name, value]) =>
      tables(`${title}: ${spaced(name)}`, /** @type {Hardware} */ (value)),
    ),
  );
}

/** @param {unknown} value @returns {value is Hardware} */
function isGroup(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** @param {unknown} value @param {number} [digits] @returns {string} */
function written(value, digits = decimals(value)) {
  if (Array.isArray(value)) {
    const most = Math.max(0, ...value.map(decimals)); // The same number for all.
    return value.map((each) => written(each, most)).join(", ");
  }
  if (typeof value === "number") return fixed(value, digits);
  if (typeof value === "boolean") return value ? "yes" : "no";
  return value === null ? "–" : String(value);
}

// Number of decimals needed, at most two.
/** @param {unknown} value */
function decimals(value) {
  if (typeof value !== "number") return 0;
  return [0, 1].find((digits) => Math.abs(value - Number(value.toFixed(digits))) < 0.005) ?? 2;
}
