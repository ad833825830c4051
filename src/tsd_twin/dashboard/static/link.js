// WebSocket to the dashboard server, with the latest robot state and the link quality.

// Link quality relative to the maximum command age.
const GOOD = 0.4;
const FAIR = 0.8;
const GOOD_LOSS = 0.05;
const FAIR_LOSS = 0.2;

/**
 * Return the median and the 95th percentile minus the median; null without numbers.
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
 * Return a value that must be known by now, for example because of message order: the robot message
 * always precedes its states.
 * @template T
 * @param {T | null} value
 * @throws {TypeError} when it is null
 */
export function assertDefined(value) {
  if (value === null) throw new TypeError("a value is missing that the page relies on");
  return value;
}

// Socket to the gateway, and the latest message of each type.
const HEARTBEAT_MS = 100;
const SERVER_TIMEOUT_MS = 2000; // The connection is lost after this time without an echo.
const LONGEST_BEAT_MS = 2 * HEARTBEAT_MS; // A page that stalled for longer has unread echoes.
const RETRY_MS = 500;
const LOADING_BEATS = 50; // Five seconds of page activity; loading may block for longer.
const MAX_BUFFERED_BYTES = 1024; // Messages buffered in the browser would be too old to send.
const URGENT = new Set(["release", "stop"]); // Always sent, because they can only stop the robot.

const MAX_ROUND_TRIPS = 50; // Five seconds.
const MAX_STATES = 100;

const STALE_MS = 300;

export class Link {
  /** @param {string} page @param {string} [name] Typed operator name. */
  constructor(page, name = "") {
    this.page = page;
    this.name = name;
    this.connected = false;
    this._loadingBeats = LOADING_BEATS; // Remaining beats until the first state is expected.
    /** @type {SessionInfo | null} */
    this.welcome = null;
    /** @type {RobotInfo | null} */
    this.robot = null; // Constant properties of the displayed robot.
    /** @type {string | null} */
    this._requestedRobot = null; // Requested robot, until it is shown.
    /** @type {RobotState | null} */
    this.state = null;
    this.stateMs = -Infinity; // Arrival time on the `performance.now` clock.
    /** @type {number | null} */
    this.pageMs = null; // Recent median round trip to the gateway.
    /** @type {number | null} */
    this.pageJitterMs = null; // 95th percentile minus the median.
    this.lost = 0; // Recent fraction of lost states.
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
    this._silentMs = 0; // Time without an echo while the page was running.
  }

  /**
   * Call `listener` with messages of some types, or for `up`, `down`, `beat`, until `signal`.
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

  /** Reconnect with another operator name. @param {string} name */
  rename(name) {
    if (name === this.name) return;
    this.name = name;
    const socket = this._socket;
    if (socket === null) return; // The next connection uses it.
    this._onClose();
    socket.close();
  }

  /**
   * Send a message without queueing; return whether it was sent.
   * @param {PageMessage | TimelineRequest} message
   */
  send(message) {
    const socket = this._socket;
    if (socket?.readyState !== WebSocket.OPEN) return false;
    if (socket.bufferedAmount > MAX_BUFFERED_BYTES && !URGENT.has(message.t)) return false;
    socket.send(JSON.stringify(message));
    return true;
  }

  /** Select another robot, once connected. @param {string} id */
  choose(id) {
    this._requestedRobot = id;
    this.send({ t: "robot", id });
  }

  /** Age of the latest state in ms, including its age on arrival. */
  ageMs() {
    return performance.now() - this.stateMs + (this.state?.age_ms ?? 0);
  }

  /** Whether the first state is still expected, so that nothing is lost yet. */
  isLoading() {
    return this._loadingBeats > 0;
  }

  isStale() {
    return !this.connected || this.ageMs() > STALE_MS;
  }

  /** Round trip from page to robot in ms, or null if unknown. */
  roundTripMs() {
    const robotMs = this.state?.rtt_ms ?? NaN;
    if (!this.connected || this.pageMs === null || !Number.isFinite(robotMs)) return null;
    return this.pageMs + robotMs;
  }

  /** 95th percentile of the round trip minus its median in ms, or null if unknown. */
  jitterMs() {
    if (this.roundTripMs() === null) return null;
    return (this.pageJitterMs ?? 0) + (this.state?.rtt_jitter_ms ?? 0);
  }

  /**
   * Return "good", "fair", "poor" or "none", and the fraction of the maximum age used by a late
   * command (round trip plus jitter). On arrival, a command is up to one state period (50 ms) older
   * than that, so above 0.8 some arrive too late.
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
        this._onClose(); // First, because closing the socket may take arbitrarily long.
        socket?.close();
      } else {
        const focus = window.tsd.hasFocus() && document.visibilityState === "visible";
        this.send({ t: "heartbeat", status_seq: this.state?.status_seq ?? 0, sent_ms: now, focus });
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
        this._count(message.status_seq);
        break;
      case "robot":
        if (message.id !== this.robot?.id) this.stateMs = -Infinity;
        this._seen = [];
        this._requestedRobot = null;
        this.robot = message;
        this.history = []; // The gateway sends it again.
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

  /** After reconnecting, select the same robot. @param {SessionInfo} welcome */
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

  /** Detect lost states by their sequence numbers. @param {number} seen */
  _count(seen) {
    const newest = this._seen.at(-1) ?? -1;
    this._seen = seen < newest ? [seen] : [...this._seen.slice(1 - MAX_STATES), seen];
    const sent = seen - this._seen[0] + 1;
    this.lost = Math.max(0, 1 - this._seen.length / sent);
  }

  /** @param {keyof LinkEvents} type @param {ServerMessage} [message] */
  _emit(type, message) {
    const told = /** @type {never} */ (message); // Has this type, as guaranteed by `on`.
    const listeners = this._listeners.get(type) ?? new Set();
    // Listeners added during the call start with the next message.
    for (const listener of [...listeners]) if (listeners.has(listener)) listener(told);
  }
}
