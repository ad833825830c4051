// WebSocket to the dashboard server with the newest state of the robot, and the quality of the link.

// How good the link is, measured against the age up to which commands count.
const GOOD = 0.4;
const FAIR = 0.8;
const GOOD_LOSS = 0.05;
const FAIR_LOSS = 0.2;

/**
 * Return the median of some numbers, and how much more one in twenty is; null without any.
 * @param {number[]} numbers
 */
function medianAndJitter(numbers) {
  if (numbers.length === 0) return { middle: null, jitter: null };
  const sorted = [...numbers].sort((a, b) => a - b);
  const at = (/** @type {number} */ share) =>
    sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)];
  return { middle: at(0.5), jitter: at(0.95) - at(0.5) };
}

/**
 * Return a value that is known by now, for example by the order of messages: no state comes before
 * its robot.
 * @template T
 * @param {T | null} value
 * @throws {TypeError} when it is null
 */
export function known(value) {
  if (value === null) throw new TypeError("a value is missing that the page relies on");
  return value;
}

// The socket to the gateway, and the newest of everything that it has said.
const HEARTBEAT_MS = 100;
const SERVER_TIMEOUT_MS = 2000; // No echo for this long: the connection is lost, whatever the browser says.
const LONGEST_BEAT_MS = 2 * HEARTBEAT_MS; // A page that stalled for longer has echoes yet to read.
const RETRY_MS = 500;
const LOADING_BEATS = 50; // Five seconds in which the page ran: loading may block it for longer.
const MAX_BUFFERED_BYTES = 1024; // What waits in the browser is too old already to be sent.
const URGENT = new Set(["release", "stop"]); // Sent in any case: all that they do is stop the robot.

const MAX_ROUND_TRIPS = 50; // Five seconds.
const MAX_STATES = 100;

const STALE_MS = 300;

export class Link {
  /** @param {string} page @param {string} [name] What the operator has typed. */
  constructor(page, name = "") {
    this.page = page;
    this.name = name;
    this.connected = false;
    this._loadingBeats = LOADING_BEATS; // Left until the first state has to be there.
    /** @type {SessionInfo | null} */
    this.welcome = null;
    /** @type {RobotInfo | null} */
    this.robot = null; // What does not change about the robot that is watched.
    /** @type {string | null} */
    this._requestedRobot = null; // The robot that was chosen, until it is shown.
    /** @type {RobotState | null} */
    this.state = null;
    this.stateMs = -Infinity; // When it came, on the clock of `performance.now`.
    /** @type {number | null} */
    this.pageMs = null; // Round trip to the gateway, median of the last few.
    /** @type {number | null} */
    this.pageJitterMs = null; // How much longer one in twenty takes.
    this.lost = 0; // Share of the states that did not come, of the last few seconds.
    /** @type {(RobotEvent & { atMs: number })[]} */
    this.history = []; // Events, oldest first.
    /** @type {Map<string, Set<(message: never) => void>>} */
    this._listeners = new Map();
    /** @type {number[]} */
    this._trips = [];
    /** @type {number[]} */
    this._seen = [];
    /** @type {WebSocket | null} */
    this._socket = null;
    this._beatMs = performance.now();
    this._silentMs = 0; // Time without an echo in which the page ran.
  }

  /**
   * Call `listener` with each message of some types, or for `up`, `down`, `beat`, until `signal`.
   * @template {keyof LinkEvents} K
   * @param {K | K[]} types
   * @param {(message: LinkEvents[K]) => void} listener
   * @param {AbortSignal} [signal]
   */
  on(types, listener, signal) {
    for (const type of [types].flat()) {
      const listeners = this._listeners.get(type) ?? new Set();
      this._listeners.set(type, listeners.add(listener));
      signal?.addEventListener("abort", () => listeners.delete(listener));
    }
  }

  open() {
    this._connect();
    setInterval(() => this._sendHeartbeat(), HEARTBEAT_MS);
  }

  /** Connect again under another name of the operator. @param {string} name */
  rename(name) {
    if (name === this.name) return;
    this.name = name;
    const socket = this._socket;
    if (socket === null) return; // The next one has it.
    this._onClose();
    socket.close();
  }

  /** Send a message now or never; return whether it went out. @param {PageMessage | TimelineRequest} message */
  send(message) {
    const socket = this._socket;
    if (socket?.readyState !== WebSocket.OPEN) return false;
    if (socket.bufferedAmount > MAX_BUFFERED_BYTES && !URGENT.has(message.t)) return false;
    socket.send(JSON.stringify(message));
    return true;
  }

  /** Turn to another robot, once there is a connection. @param {string} id */
  choose(id) {
    this._requestedRobot = id;
    this.send({ t: "robot", id });
  }

  /** Milliseconds since the newest state came, or since the robot said what is in it. */
  ageMs() {
    return performance.now() - this.stateMs + (this.state?.age_ms ?? 0);
  }

  /** Whether the first state is still expected: a page that loads has lost nothing. */
  isLoading() {
    return this._loadingBeats > 0;
  }

  isStale() {
    return !this.connected || this.ageMs() > STALE_MS;
  }

  /** Page to robot and back, in ms; null when one of the two is not known. */
  roundTripMs() {
    const robotMs = this.state?.robot_ms ?? NaN;
    if (!this.connected || this.pageMs === null || !Number.isFinite(robotMs)) return null;
    return this.pageMs + robotMs;
  }

  /** How much longer one in twenty round trips takes, in ms; null when it is not known. */
  jitterMs() {
    if (this.roundTripMs() === null) return null;
    return (this.pageJitterMs ?? 0) + (this.state?.robot_jitter_ms ?? 0);
  }

  /**
   * Return "good", "fair", "poor" or "none", and the share of the allowed age that a late command
   * uses up: the round trip and its jitter. A command is that old when it arrives, or up to a
   * state's period, 50 ms, older; so beyond four fifths some come too late.
   */
  quality() {
    const tripMs = this.isStale() ? null : this.roundTripMs();
    const allowedMs = 1000 * (this.state?.status.limits.max_command_age_s ?? 0);
    if (tripMs === null || allowedMs <= 0) return { grade: "none", used: null };
    const used = (tripMs + (this.jitterMs() ?? 0)) / allowedMs;
    if (used < GOOD && this.lost < GOOD_LOSS) return { grade: "good", used };
    return { grade: used < FAIR && this.lost < FAIR_LOSS ? "fair" : "poor", used };
  }

  _connect() {
    const address = new URL(`teleop?page=${this.page}`, location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    if (window.tsd.recording !== null) address.searchParams.set("recording", window.tsd.recording);
    if (this.name !== "") address.searchParams.set("name", this.name);
    const socket = new WebSocket(address);
    this._socket = socket;
    socket.onopen = () => {
      this._silentMs = 0;
      this.connected = true;
      this._emit("up");
      this._sendHeartbeat();
    };
    socket.onmessage = (event) => {
      if (socket === this._socket) this._receive(JSON.parse(event.data));
    };
    socket.onclose = () => {
      if (socket === this._socket) this._onClose();
    };
  }

  _onClose() {
    this._socket = null;
    const was = this.connected;
    this.connected = false;
    this._trips = [];
    this._seen = [];
    this.pageMs = this.pageJitterMs = null;
    if (was) {
      this._loadingBeats = 0;
      this._emit("down");
    }
    setTimeout(() => this._connect(), RETRY_MS);
  }

  _sendHeartbeat() {
    if (this._loadingBeats > 0) this._loadingBeats -= 1;
    const now = performance.now();
    this._silentMs += Math.min(now - this._beatMs, LONGEST_BEAT_MS);
    this._beatMs = now;
    if (this.connected) {
      if (this._silentMs > SERVER_TIMEOUT_MS) {
        const socket = this._socket;
        this._onClose(); // Before closing it: that may take as long as it likes.
        socket?.close();
      } else {
        const focus = window.tsd.hasFocus() && document.visibilityState === "visible";
        this.send({ t: "heartbeat", seen: this.state?.seen ?? 0, sent_ms: now, focus });
      }
    }
    this._emit("beat");
  }

  /** @param {ServerMessage} message */
  _receive(message) {
    switch (message.t) {
      case "heartbeat":
        this._measure(message.sent_ms);
        return;
      case "state":
        this.state = message;
        this.stateMs = performance.now();
        this._loadingBeats = 0;
        this._count(message.seen);
        break;
      case "robot":
        if (message.id !== this.robot?.id) this.stateMs = -Infinity;
        this._seen = [];
        this._requestedRobot = null;
        this.robot = message;
        this.history = []; // The gateway tells it again.
        break;
      case "welcome":
        this.welcome = message;
        this._keepRobot(message);
        break;
      case "reply":
        if (message.to === "robot") this._requestedRobot = null;
        break;
      case "event":
        this.history = [
          ...this.history.slice(-99),
          { ...message, atMs: Date.now() - 1000 * message.age_s },
        ];
        break;
    }
    this._emit(message.t, message);
  }

  /** After a new connection, go on with the robot as before. @param {SessionInfo} welcome */
  _keepRobot({ robot, robots }) {
    const before = this._requestedRobot ?? this.robot?.id ?? robot;
    if (before !== null && before !== robot && robots.some(({ id }) => id === before))
      this.send({ t: "robot", id: before });
  }

  /** @param {number} sentMs */
  _measure(sentMs) {
    this._silentMs = 0;
    this._trips = [...this._trips.slice(1 - MAX_ROUND_TRIPS), performance.now() - sentMs];
    this.pageMs = medianAndJitter(this._trips.slice(-9)).middle;
    this.pageJitterMs = medianAndJitter(this._trips).jitter;
  }

  /** The robot numbers its states, so what is missing is seen. @param {number} seen */
  _count(seen) {
    const newest = this._seen.at(-1) ?? -1;
    this._seen = seen < newest ? [seen] : [...this._seen.slice(1 - MAX_STATES), seen];
    const sent = seen - this._seen[0] + 1;
    this.lost = Math.max(0, 1 - this._seen.length / sent);
  }

  /** @param {keyof LinkEvents} type @param {ServerMessage} [message] */
  _emit(type, message) {
    const told = /** @type {never} */ (message); // Of this type, as `on` promises.
    const listeners = this._listeners.get(type) ?? new Set();
    // Those that a listener adds are for the next message.
    for (const listener of [...listeners]) if (listeners.has(listener)) listener(told);
  }
}
