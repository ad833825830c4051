// Plot recorder: records the selected fields from page load or selection, even if the tab is
// closed. The selection is kept in the browser.

import { kindOf } from "./kinds.js";
import { PlotBuffer } from "./plot_buffer.js";
import { fieldsOf, valueOf } from "./plot_fields.js";

export const MAX_FIELDS = 16;
const KEY = "tsd.plots";
const RETRY_MS = 1000;
const USUAL_WINDOW_S = 20;
const [MIN_WINDOW_S, MAX_WINDOW_S] = [1, 600];

export class Recorder {
  /** @param {Link} link */
  constructor(link) {
    this.buffer = new PlotBuffer();
    /** @type {RobotInfo | null} */
    this.robot = null; // The recorded robot.
    /** @type {Map<string, PlotField>} */
    this.known = new Map(); // All fields, by name.
    /** @type {string[]} */
    this.names = []; // Selected fields; the robot may not have sent all of them yet.
    /** @type {{ windowS: number, fields: Record<string, string[]> }} By robot id. */
    this._kept = { windowS: USUAL_WINDOW_S, fields: {}, ...stored() };
    this._link = link;
    /** @type {object} */
    this._sample = {};
    this._arrivedMs = 0;
    this._searchedMs = -Infinity;
    this._requestedMs = -Infinity;
    link.on("state", (state) => this._take(state));
    link.on("robot", (robot) => this._begin(robot));
    link.on("past", ({ states }) => {
      this.buffer.clear(); // The cursor of a recording has jumped.
      for (const state of states) this._take(state);
    });
  }

  get windowS() {
    return this._kept.windowS;
  }

  set windowS(seconds) {
    this._kept.windowS = Math.max(MIN_WINDOW_S, Math.min(MAX_WINDOW_S, seconds));
    store(this._kept);
  }

  /** Selected fields that the robot has. */
  get fields() {
    return this.names.flatMap((name) => this.known.get(name) ?? []);
  }

  /** Estimated current robot time. */
  nowS() {
    return this.buffer.newestS + (performance.now() - this._arrivedMs) / 1000;
  }

  /** Plot these fields, or the defaults. @param {string[] | null} names */
  choose(names) {
    if (this.robot === null) return;
    if (names === null) delete this._kept.fields[this.robot.id];
    else this._kept.fields[this.robot.id] = names;
    store(this._kept);
    this._select();
  }

  _select() {
    if (this.robot === null) return;
    const chosen = this._kept.fields[this.robot.id] ?? kindOf(this.robot).plots(this.robot);
    this.names = chosen.slice(0, MAX_FIELDS);
    this.buffer.select(this.names);
    this._requestedMs = -Infinity;
  }

  /** @param {RobotInfo} robot */
  _begin(robot) {
    if (this.robot?.id !== robot.id) this.buffer.clear();
    this.robot = robot; // The same robot may have a new description.
    this.known = new Map();
    this._searchedMs = -Infinity;
    this._select();
  }

  /** @param {RobotState} state */
  _take(state) {
    if (this.robot === null) return;
    const link = {
      round_trip_ms: this._link.roundTripMs(),
      jitter_ms: this._link.jitterMs(),
      lost_percent: 100 * this._link.lost,
    };
    this._sample = { ...state, link };
    this._arrivedMs = performance.now();
    const isMissing = this.names.some((name) => !this.known.has(name)); // Null until measured.
    if (isMissing && this._arrivedMs - this._searchedMs >= RETRY_MS) this.search();
    this._request(state);
    if (state.robot_s < this.buffer.newestS) this.buffer.clear(); // The robot has restarted.
    this.buffer.add(state.robot_s, (name) => valueOf(this.known.get(name), this._sample));
  }

  /** Add the fields of the latest state to the known ones. */
  search() {
    if (this.robot === null) return;
    this.known = new Map([...this.known, ...fieldsOf(this.robot, this._sample)]);
    this._searchedMs = performance.now();
  }

  /** Request fields that are not in every state until they arrive. @param {RobotState} state */
  _request({ plot }) {
    const offered = this.robot?.plot_fields ?? [];
    const names = this.names.filter((name) => offered.includes(name));
    const isSent = Object.keys(plot).length === names.length && names.every((name) => name in plot);
    if (isSent || this._arrivedMs - this._requestedMs < RETRY_MS) return;
    if (this._link.send({ t: "plot_fields", names })) this._requestedMs = this._arrivedMs;
  }
}

/** Return the stored settings that are valid. */
function stored() {
  try {
    const { windowS, fields } = JSON.parse(localStorage.getItem(KEY) ?? "{}");
    return {
      ...(windowS >= MIN_WINDOW_S && windowS <= MAX_WINDOW_S ? { windowS } : {}),
      ...(Object.values(fields ?? {}).every(Array.isArray) ? { fields: { ...fields } } : {}),
    };
  } catch {
    return {}; // Without storage, use the defaults.
  }
}

/** @param {object} settings */
function store(settings) {
  try {
    localStorage.setItem(KEY, JSON.stringify(settings));
  } catch {
    // Without storage, settings last as long as the page.
  }
}
