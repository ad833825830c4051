// Settings of the Student tab, their link, and the requests for results. The dashboard server
// computes them without a robot.

const ASK_EVERY_MS = 80; // The server accepts 20 per second.
const GIVE_UP_MS = 1500; // Retry a request without a response after this time.
const DEFAULT_BASE = "tsd";
/** @type {Triple} */
const DEFAULT_TWIST = [0.5, 0, 0];

/**
 * Return the settings in a query string, or null.
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
 * Return an address with the settings: robot, parameters that differ from it, and twist.
 * @param {StudentSetting} setting @param {string} address
 */
export function linkTo({ base, knobs, twist }, address) {
  const url = new URL(address);
  url.search = url.hash = ""; // Query parameters of the page or viser are not shared.
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
  /** @param {Link} link @param {string} query Query string of the page address. */
  constructor(link, query) {
    this._link = link;
    const given = settingOf(query);
    this.isLinked = given !== null; // From the address, so open its tab once.
    /** @type {StudentSetting} */
    this.setting = given ?? { base: DEFAULT_BASE, knobs: {}, twist: DEFAULT_TWIST };
    /** @type {StudentReply | null} */
    this.reply = null;
    this._number = 0;
    this._isSent = false; // The latest settings have been requested.
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

  /**
   * Set a parameter; its default value counts as unchanged.
   * @param {string} key @param {number} value
   */
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

  /** Request the description as a file, sent with the reply. */
  requestToml() {
    this._wantsToml = true;
    this._changed();
  }

  /** Request the results unless known; call this while they are shown. */
  refresh() {
    if (performance.now() - this._askedMs > GIVE_UP_MS) this._forget();
    if (!this._isSent) this._ask();
  }

  /** Requests in flight will get no response. */
  _forget() {
    if (this._isAsking) this._isAsking = this._isSent = false;
  }

  _changed() {
    this._isSent = false;
    this._ask();
  }

  _ask() {
    if (this._isAsking || this._timer !== null) return; // The latest settings are requested next.
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
    if (reply.number !== this._number) return; // Reply to an abandoned request.
    this._isAsking = false;
    if (reply.toml !== null || reply.problem !== "") this._wantsToml = false;
    this.reply = reply;
    for (const listener of [...this._listeners]) listener(reply);
    if (!this._isSent) this._ask();
  }
}
