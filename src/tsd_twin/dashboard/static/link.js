// WebSocket to the dashboard server with the newest state of the robot, and the quality of the link.

// Link quality, relative to the maximum age of commands.
const GOOD = 0.4;
const FAIR = 0.8;
const GOOD_LOSS = 0.05;
const FAIR_LOSS = 0.2;

/**
 * Return "good", "fair", "poor" or "none", and the share of the allowed age that a late command
 * uses up: the round trip and its jitter. A command is that old when it arrives, or up to a state's
 * period, 50 ms, older; so beyond four fifths some come too late.
 */
export function quality({ tripMs, jitterMs, lost, allowedMs }) {
  if (tripMs === null || !(allowedMs > 0)) return { grade: "none", used: null };
  const used = (tripMs + (jitterMs ?? 0)) / allowedMs;
  if (used < GOOD && lost < GOOD_LOSS) return { grade: "good", used };
  return { grade: used < FAIR && lost < FAIR_LOSS ? "fair" : "poor", used };
}

/** Return the median of some numbers, and how much more one in twenty is; null without any. */
export function medianAndJitter(numbers) {
  if (numbers.length === 0) return { middle: null, jitter: null };
  const sorted = [...numbers].sort((a, b) => a - b);
  const at = (share) => sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)];
  return { middle: at(0.5), jitter: at(0.95) - at(0.5) };
}

// WebSocket to the dashboard server, with its newest messages.
const HEARTBEAT_MS = 100;
const SERVER_TIMEOUT_MS = 2000; // No echo for this long: the connection is lost, whatever the browser says.
const RETRY_MS = 500;
const MAX_BUFFERED_BYTES = 1024; // What waits in the browser is too old already to be sent.
const URGENT = new Set(["release", "stop"]); // Sent in any case: all that they do is stop the robot.

const MAX_ROUND_TRIPS = 50; // Five seconds.
const MAX_STATES = 100;

const STALE_MS = 300;

export class Link {
  constructor(page) {
    this.page = page;
    this.connected = false;
    this.welcome = null;
    this.robot = null; // What does not change about the robot that is watched.
    this._requestedRobot = null; // The robot that was chosen, until it is shown.
    this.state = null;
    this.stateMs = -Infinity; // When it came, on the clock of `performance.now`.
    this.pageMs = null; // Round trip to the gateway, median of the last few.
    this.pageJitterMs = null; // How much longer one in twenty takes.
    this.lost = 0; // Share of the states that did not come, of the last few seconds.
    this.history = []; // Events, oldest first.
    this._listeners = new Map();
    this._trips = [];
    this._seen = [];
    this._socket = null;
  }

  /** Call `listener` with each message of a type, or for `up`, `down`, `beat`. */
  on(type, listener) {
    if (!this._listeners.has(type)) this._listeners.set(type, []);
    this._listeners.get(type).push(listener);
  }

  open() {
    this._connect();
    setInterval(() => this._sendHeartbeat(), HEARTBEAT_MS);
  }

  /** Send a message now or never; return whether it went out. */
  send(message) {
    const socket = this._socket;
    if (socket?.readyState !== WebSocket.OPEN) return false;
    if (socket.bufferedAmount > MAX_BUFFERED_BYTES && !URGENT.has(message.t)) return false;
    socket.send(JSON.stringify(message));
    return true;
  }

  /** Turn to another robot, once there is a connection. */
  choose(id) {
    this._requestedRobot = id;
    this.send({ t: "robot", id });
  }

  /** Milliseconds since the newest state came, or since the robot said what is in it. */
  ageMs() {
    return performance.now() - this.stateMs + (this.state?.age_ms ?? 0);
  }

  isStale() {
    return !this.connected || this.ageMs() > STALE_MS;
  }

  /** Page to robot and back, in ms; null when one of the two is not known. */
  roundTripMs() {
    if (!this.connected || this.pageMs === null || !Number.isFinite(this.state?.robot_ms ?? NaN))
      return null;
    return this.pageMs + this.state.robot_ms;
  }

  /** How much longer one in twenty round trips takes, in ms; null when it is not known. */
  jitterMs() {
    if (this.roundTripMs() === null) return null;
    return (this.pageJitterMs ?? 0) + (this.state.robot_jitter_ms ?? 0);
  }

  _connect() {
    const address = new URL(`teleop?page=${this.page}`, location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this._socket = socket;
    socket.onopen = () => {
      this._echoMs = performance.now();
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
    if (was) this._emit("down");
    setTimeout(() => this._connect(), RETRY_MS);
  }

  _sendHeartbeat() {
    if (this.connected) {
      const now = performance.now();
      if (now - this._echoMs > SERVER_TIMEOUT_MS) {
        const socket = this._socket;
        this._onClose(); // Before closing it: that may take as long as it likes.
        socket.close();
      } else {
        const focus = window.tsd.hasFocus() && document.visibilityState === "visible";
        this.send({ t: "beat", seen: this.state?.seen ?? 0, sent_ms: now, focus });
      }
    }
    this._emit("beat");
  }

  _receive(message) {
    switch (message.t) {
      case "beat":
        this._measure(message.sent_ms);
        return;
      case "state":
        this.state = message;
        this.stateMs = performance.now();
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
        this.history = [...this.history.slice(-99), { ...message, atMs: Date.now() }];
        break;
    }
    this._emit(message.t, message);
  }

  /** After a new connection, go on with the robot that was watched before. */
  _keepRobot({ robot, robots }) {
    const before = this._requestedRobot ?? this.robot?.id ?? robot;
    if (before !== robot && robots.some(({ id }) => id === before))
      this.send({ t: "robot", id: before });
  }

  _measure(sentMs) {
    this._echoMs = performance.now();
    this._trips = [...this._trips.slice(1 - MAX_ROUND_TRIPS), this._echoMs - sentMs];
    this.pageMs = medianAndJitter(this._trips.slice(-9)).middle;
    this.pageJitterMs = medianAndJitter(this._trips).jitter;
  }

  /** The robot numbers its states, so what is missing is seen. */
  _count(seen) {
    const newest = this._seen.at(-1) ?? -1;
    this._seen = seen < newest ? [seen] : [...this._seen.slice(1 - MAX_STATES), seen];
    const sent = seen - this._seen[0] + 1;
    this.lost = Math.max(0, 1 - this._seen.length / sent);
  }

  _emit(type, message) {
    for (const listener of this._listeners.get(type) ?? []) listener(message);
  }
}
