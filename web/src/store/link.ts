// Connection to the dashboard: the latest message of each kind as signals, and the round trip.

import { signal } from "@preact/signals";
import type * as wire from "../generated/wire";
import { Lanes, MAX_BUFFERED_BYTES, SILENT_MS } from "./lanes";

type Incoming = wire.ServerMessage | wire.RecordedServerMessage;
type Kind = Incoming["t"];
type Listener<K extends Kind> = (message: Extract<Incoming, { t: K }>) => void;

export interface PastEvent extends wire.RobotEvent {
  /** Wall-clock time of the event. */
  atMs: number;
}

const HEARTBEAT_MS = 100;
const LONGEST_BEAT_MS = 2 * HEARTBEAT_MS; // A page that stalled for longer has unread messages.
const RETRY_MS = 500;
const LOADING_BEATS = 50; // Five seconds of page activity; loading may block for longer.
const URGENT = new Set<string>(["release", "stop"]); // They can only stop robots: over all sockets.
const LATEST = new Set<string>(["drive", "follow_plan", "heartbeat"]); // Over one socket each.
const MAX_ROUND_TRIPS = 50; // Five seconds.
const MAX_STATES = 100;
const MAX_HISTORY = 100;

export function socketAddress(path: string, query: Record<string, string>): URL {
  const address = new URL(`${path}?${new URLSearchParams(query)}`, document.baseURI);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  return address;
}

export class Link {
  readonly connected = signal(false);
  readonly welcome = signal<wire.SessionInfo | null>(null);
  readonly robot = signal<wire.RobotInfo | null>(null);
  readonly state = signal<wire.RobotState | null>(null);
  /** Events of the robot, oldest first. */
  readonly history = signal<readonly PastEvent[]>([]);
  /** Counts heartbeats: whatever depends on the time that passes reads it. */
  readonly beat = signal(0);
  /** Arrival of the latest state on the `performance.now` clock. */
  stateMs = -Infinity;
  /** End of the latest connection on the `performance.now` clock. */
  lostMs = performance.now();
  /** Recent median round trip to the dashboard, and the 95th percentile minus the median. */
  pageMs: number | null = null;
  pageJitterMs: number | null = null;
  /** Recent fraction of states that did not arrive. */
  lost = 0;

  #listeners = new Map<Kind, Set<(message: never) => void>>();
  #socket: WebSocket | null = null;
  #lanes = new Lanes(
    () => socketAddress("teleop/lane", { page: this.page }),
    (text) => this.#receive(JSON.parse(text) as Incoming),
  );
  #number = 0; // Counts the messages that may travel over any socket.
  #requestedRobot: string | null = null;
  #loadingBeats = LOADING_BEATS;
  trips: number[] = [];
  #seen: number[] = []; // Sequence numbers of the latest states.
  #beatMs = performance.now();
  #silentMs = 0; // Time without a message while the page was running.

  /**
   * `page` has 16 hex digits, and grants no rights. A `recording` is shown instead of the live
   * robots. `name` is the display name that the operator typed.
   */
  constructor(
    readonly page: string,
    readonly recording: string | null = null,
    private name = "",
  ) {}

  /** Call `listener` with each message of a kind; returns a function that ends it. */
  on<K extends Kind>(kind: K, listener: Listener<K>): () => void {
    const listeners = this.#listeners.get(kind) ?? new Set();
    this.#listeners.set(kind, listeners.add(listener));
    return () => void listeners.delete(listener);
  }

  open(): void {
    this.#connect();
    setInterval(() => this.#sendHeartbeat(), HEARTBEAT_MS);
  }

  /** Change the display name; operator and lease are unaffected. */
  rename(name: string): void {
    if (name === this.name) return;
    this.name = name; // For the next connection.
    if (this.recording === null) this.send({ t: "name", name });
  }

  /** Send a message without queueing; return whether it was sent. */
  send(message: wire.PageMessage | wire.RecordedPageMessage): boolean {
    const main = this.#socket;
    if (main?.readyState !== WebSocket.OPEN) return false;
    const isUrgent = URGENT.has(message.t);
    const socket = LATEST.has(message.t) ? this.#lanes.next(main) : main;
    if (socket.bufferedAmount > MAX_BUFFERED_BYTES && !isUrgent) return false;
    const text = JSON.stringify(this.#numbered(message));
    for (const each of isUrgent ? [main, ...this.#lanes.open] : [socket]) each.send(text);
    return true;
  }

  /** Number a message, so that the dashboard recognizes it if another socket delivers it late. */
  #numbered(message: wire.PageMessage | wire.RecordedPageMessage): object {
    if (message.t === "heartbeat" || !(LATEST.has(message.t) || URGENT.has(message.t)))
      return message;
    const number = (this.#number += 1);
    const selection = this.robot.peek()?.selection ?? 0;
    return message.t === "stop" ? { ...message, number } : { ...message, number, selection };
  }

  /** Select another robot, once connected. */
  choose(id: string): void {
    this.#requestedRobot = id;
    this.send({ t: "robot", id });
  }

  /** Age of the latest state in ms, including its age on arrival. */
  ageMs(): number {
    return performance.now() - this.stateMs + (this.state.peek()?.age_ms ?? 0);
  }

  /** Whether the first state is still expected, so that nothing is lost yet. */
  isLoading(): boolean {
    return this.#loadingBeats > 0;
  }

  #connect(): void {
    const { page, recording, name } = this;
    const more = { ...(recording !== null && { recording }), ...(name !== "" && { name }) };
    const socket = new WebSocket(socketAddress("teleop", { page, ...more }));
    this.#socket = socket;
    socket.onopen = () => {
      this.#silentMs = 0;
      this.connected.value = true;
      this.#sendHeartbeat();
    };
    socket.onmessage = (event) => {
      if (socket !== this.#socket) return;
      this.#silentMs = 0;
      this.#receive(JSON.parse(event.data as string) as Incoming);
    };
    socket.onclose = () => {
      if (socket === this.#socket) this.#onClose();
    };
  }

  #onClose(): void {
    this.#socket = null;
    this.#lanes.close();
    this.trips = [];
    this.#seen = [];
    this.pageMs = this.pageJitterMs = null;
    if (this.connected.peek()) {
      this.#loadingBeats = 0;
      this.lostMs = performance.now();
      this.connected.value = false;
    }
    setTimeout(() => this.#connect(), RETRY_MS);
  }

  #sendHeartbeat(): void {
    if (this.#loadingBeats > 0) this.#loadingBeats -= 1;
    const now = performance.now();
    const ranMs = Math.min(now - this.#beatMs, LONGEST_BEAT_MS);
    this.#silentMs += ranMs;
    this.#beatMs = now;
    if (this.connected.peek() && this.#silentMs > SILENT_MS) {
      const socket = this.#socket;
      this.#onClose(); // First, because closing the socket may take arbitrarily long.
      socket?.close();
    } else if (this.connected.peek()) {
      if (this.state.peek()?.has_control) this.#lanes.keep(ranMs);
      const focus = document.hasFocus() && document.visibilityState === "visible";
      const status_seq = this.state.peek()?.status_seq ?? 0;
      this.send({ t: "heartbeat", status_seq, sent_ms: now, focus });
    }
    this.beat.value += 1;
  }

  #receive(message: Incoming): void {
    switch (message.t) {
      case "heartbeat":
        this.#measure(message.sent_ms);
        break;
      case "state":
        if (this.#isLate(message)) return;
        this.stateMs = performance.now();
        this.#loadingBeats = 0;
        this.state.value = message;
        break;
      case "robot":
        if (message.id !== this.robot.peek()?.id) this.stateMs = -Infinity;
        if (message.selection !== this.robot.peek()?.selection) this.#seen = [];
        this.#requestedRobot = null;
        this.history.value = []; // The dashboard sends it again.
        this.robot.value = message;
        break;
      case "welcome":
        this.welcome.value = message;
        this.#keepRobot(message);
        break;
      case "reply":
        if (message.to === "robot") this.#requestedRobot = null;
        break;
      case "event": {
        const atMs = Date.now() - 1000 * (message.age_s ?? 0);
        this.history.value = [...this.history.peek(), { ...message, atMs }].slice(-MAX_HISTORY);
        break;
      }
    }
    const listeners = this.#listeners.get(message.t) ?? new Set();
    // Listeners added during the call start with the next message.
    for (const listener of [...listeners]) if (listeners.has(listener)) listener(message as never);
  }

  /** After reconnecting, select the same robot. */
  #keepRobot({ robot, robots }: wire.SessionInfo): void {
    const before = this.#requestedRobot ?? this.robot.peek()?.id ?? robot;
    if (before !== null && before !== robot && robots.some(({ id }) => id === before))
      this.send({ t: "robot", id: before });
  }

  /** Count a state; return whether it is of another robot, or another socket has overtaken it. */
  #isLate({ selection, status_seq }: wire.RobotState): boolean {
    const ordered = selection > 0;
    if (ordered && selection !== this.robot.peek()?.selection) return true;
    const newest = Math.max(-1, ...this.#seen);
    const before = !ordered && status_seq < newest ? [] : this.#seen; // A recording goes back.
    this.#seen = [...before, status_seq].slice(-MAX_STATES);
    const sent = Math.max(...this.#seen) - Math.min(...this.#seen) + 1;
    this.lost = Math.max(0, 1 - this.#seen.length / sent);
    return ordered && status_seq <= newest;
  }

  #measure(sentMs: number): void {
    this.trips = [...this.trips, performance.now() - sentMs].slice(-MAX_ROUND_TRIPS);
    this.pageMs = quantile(this.trips.slice(-9), 0.5);
    this.pageJitterMs = quantile(this.trips, 0.95) - quantile(this.trips, 0.5);
  }
}

/** Return a quantile: the smallest number that a fraction of them does not exceed. */
function quantile(numbers: readonly number[], share: number): number {
  const sorted = [...numbers].sort((a, b) => a - b);
  return sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)] ?? 0;
}
