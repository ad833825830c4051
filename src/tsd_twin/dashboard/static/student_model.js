// The setting of the Student tab, its link, and the requests for its figures. The dashboard's server
// computes; no robot is asked.

const ASK_EVERY_MS = 80; // The server takes 20 of these a second.
const GIVE_UP_MS = 1500; // A request without an answer by then is sent again.
const DEFAULT_BASE = "tsd";
/** @type {Triple} */
const DEFAULT_TWIST = [0.5, 0, 0];

/**
 * Return the setting in the query of an address; null when it has none.
 * @param {string} query @returns {StudentSetting | null}
 */
export function settingOf(query) {
  const parameters = new URLSearchParams(query);
  const base = parameters.get("student");
  if (base === null) return null;
  /** @type {Record<string, number>} */
  const knobs = {};
  for (const [key, text] of parameters) {
    const value = numberOf(text);
    if (key.includes(".") && value !== null) knobs[key] = value;
  }
  const twist = (parameters.get("twist") ?? "").split("_").map(numberOf);
  const [a, b, c] = twist;
  const isTwist = twist.length === 3 && a !== null && b !== null && c !== null;
  return { base, knobs, twist: isTwist ? [a, b, c] : DEFAULT_TWIST };
}

/**
 * Return an address with a setting: the robot, the knobs that differ from it, and the twist.
 * @param {StudentSetting} setting @param {string} address
 */
export function linkTo({ base, knobs, twist }, address) {
  const url = new URL(address);
  url.search = url.hash = ""; // What the page or viser have put there is not for others.
  url.searchParams.set("student", base);
  for (const [key, value] of Object.entries(knobs)) url.searchParams.set(key, String(value));
  url.searchParams.set("twist", twist.join("_"));
  return url.href;
}

/** @param {string} text */
function numberOf(text) {
  const value = Number(text);
  return text.trim() === "" || !Number.isFinite(value) ? null : value;
}

export class StudentModel {
  /** @param {Link} link @param {string} query Of the page's address. */
  constructor(link, query) {
    this._link = link;
    const given = settingOf(query);
    this.isLinked = given !== null; // By the address: its tab is to be opened, once.
    /** @type {StudentSetting} */
    this.setting = given ?? { base: DEFAULT_BASE, knobs: {}, twist: DEFAULT_TWIST };
    /** @type {StudentReply | null} */
    this.reply = null;
    this._number = 0;
    this._isSent = false; // The newest setting has been asked for.
    this._askedMs = -Infinity;
    this._isAsking = false;
    this._wantsToml = false;
    /** @type {ReturnType<typeof setTimeout> | null} */
    this._timer = null;
    /** @type {Set<(reply: StudentReply) => void>} */
    this._listeners = new Set();
    link.on("student", (reply) => this._take(reply));
    link.on(["down", "welcome"], () => this._forget());
  }

  /** @param {(reply: StudentReply) => void} listener @param {AbortSignal} signal */
  on(listener, signal) {
    this._listeners.add(listener);
    signal.addEventListener("abort", () => this._listeners.delete(listener));
  }

  /** @param {string} base */
  choose(base) {
    this.setting = { ...this.setting, base, knobs: {} };
    this._changed();
  }

  /** Turn a knob; back at its usual value it is no change. @param {string} key @param {number} value */
  turn(key, value) {
    const usual = this.reply?.knobs.find((knob) => knob.key === key)?.usual;
    const knobs = { ...this.setting.knobs, [key]: value };
    if (value === usual) delete knobs[key];
    this.setting = { ...this.setting, knobs };
    this._changed();
  }

  /** @param {number} axis @param {number} value */
  move(axis, value) {
    const [a, b, c] = this.setting.twist.map((old, i) => (i === axis ? value : old));
    this.setting = { ...this.setting, twist: [a, b, c] };
    this._changed();
  }

  reset() {
    this.setting = { ...this.setting, knobs: {} };
    this._changed();
  }

  /** Ask for the description as a file; the reply has it. */
  requestToml() {
    this._wantsToml = true;
    this._changed();
  }

  /** Ask for the figures, if they are not known yet; call this as long as they are shown. */
  refresh() {
    if (performance.now() - this._askedMs > GIVE_UP_MS) this._forget();
    if (!this._isSent) this._ask();
  }

  /** A request that is on its way is not answered any more. */
  _forget() {
    if (this._isAsking) this._isAsking = this._isSent = false;
  }

  _changed() {
    this._isSent = false;
    this._ask();
  }

  _ask() {
    if (this._isAsking || this._timer !== null) return; // The newest setting is asked for next.
    const waitMs = this._askedMs + ASK_EVERY_MS - performance.now();
    if (waitMs > 0) {
      this._timer = setTimeout(() => ((this._timer = null), this._ask()), waitMs);
      return;
    }
    const number = (this._number += 1);
    this._askedMs = performance.now();
    this._isSent = this._isAsking = this._link.send({
      t: "student",
      number,
      ...this.setting,
      toml: this._wantsToml,
    });
  }

  /** @param {StudentReply} reply */
  _take(reply) {
    if (reply.number !== this._number) return; // To a request that was given up.
    this._isAsking = false;
    if (reply.toml !== null || reply.problem !== "") this._wantsToml = false;
    this.reply = reply;
    for (const listener of [...this._listeners]) listener(reply);
    if (!this._isSent) this._ask();
  }
}
