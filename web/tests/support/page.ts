// A page with its session, and the other ends of it: server, pointers, keys and the clock.

import { vi } from "vitest";
import type { RobotInfo, RobotState } from "../../src/generated/wire";
import { Session } from "../../src/session";
import { nameOperatorsBy } from "../../src/text/reasons";

class Socket {
  static readonly OPEN = 1;
  static newest: Socket;
  readyState = Socket.OPEN;
  bufferedAmount = 0;
  sent: { t: string; [field: string]: unknown }[] = [];
  onopen = () => {};
  onclose = () => {};
  onmessage: (event: { data: string }) => void = () => {};

  constructor() {
    Socket.newest = this;
  }

  send(text: string): void {
    const message = JSON.parse(text);
    this.sent.push(message);
    if (message.t === "heartbeat" && this.readyState === Socket.OPEN)
      this.onmessage({ data: JSON.stringify({ t: "heartbeat", sent_ms: message.sent_ms }) });
  }

  close(): void {
    this.readyState = 3;
  }
}

export const ROBOT = {
  t: "robot",
  id: "tsd",
  title: "tsd",
  space: "floor",
  panel: "gimbals",
  limits: { speed_mps: 2, turn_rate_rad_per_s: 4 },
  modules: ["module1", "module2", "module3"],
  twist_axes: ["vx", "vy", "omega"].map((name) => ({ name, symbol: name, unit: "m/s" })),
  twist_scale_m: 1,
  sideways: true,
  wheels: [],
  joints: [],
  plot_fields: [],
  not_promised: [],
} as unknown as RobotInfo;

export const LEASE = {
  holder: "ann",
  remaining_s: 5,
  requested_by: null,
  request_expires_in_s: 0,
  reserved_for: null,
  reservation_expires_in_s: 0,
};

const STATUS = {
  mode: "ready",
  stop: null,
  arming: null,
  lease: LEASE,
  refusals: null,
  limits: {
    speed_mps: 2,
    turn_rate_rad_per_s: 4,
    max_command_age_s: 0.25,
    applied: 1,
    why: [],
  },
  operators: { bob: "Bob" },
};

type Fields = Partial<Omit<RobotState, "status">>;

type Listening = Parameters<typeof addEventListener>;
const listenings: Listening[] = [];
const listen: (...listening: Listening) => void = addEventListener;

/** End the listeners of the pages before, which would take the keys of the next. */
function forgetPages(): void {
  for (const listening of listenings.splice(0)) removeEventListener(...listening);
  vi.stubGlobal("addEventListener", (...listening: Listening) => {
    listenings.push(listening);
    listen(...listening);
  });
}

/** Use fake timers and sockets in a test file; call it in `beforeEach`. */
export function fakeBrowser(): void {
  vi.useFakeTimers();
  vi.stubGlobal("WebSocket", Socket);
  localStorage.clear();
  document.body.innerHTML = "";
  forgetPages();
  const captured = new WeakMap<Element, number>();
  Object.assign(Element.prototype, {
    setPointerCapture(this: Element, pointer: number) {
      captured.set(this, pointer);
    },
    hasPointerCapture(this: Element, pointer: number) {
      return captured.get(this) === pointer;
    },
    releasePointerCapture(this: Element, pointer: number) {
      captured.delete(this);
      fire(this, "lostpointercapture", { pointerId: pointer });
    },
  });
}

/** Open a page whose robot is ready and under its control; full deflection is 2 m/s, 4 rad/s. */
export function openPage() {
  const session = new Session();
  const { link, drive } = session;
  nameOperatorsBy(link);
  drive.level.value = 1;
  link.open();
  const socket = Socket.newest;
  const say = (message: object) => socket.onmessage({ data: JSON.stringify(message) });
  let seen = 0;
  /** Send a state; the fields of `status` replace those of a robot that is ready. */
  const state = (status: object = {}, fields: Fields = {}) =>
    say({
      t: "state",
      status_seq: (seen += 1),
      age_ms: 0,
      source: "robot",
      has_control: true,
      mode_age_s: 12,
      twist: [0, 0, 0],
      commanded: [0, 0, 0],
      pose: [1, 2, 0],
      ...fields,
      status: { ...STATUS, ...status },
    });
  /** Let time pass; a robot that is not silent sends a state every 50 ms. */
  const pass = (ms: number, status?: object, fields?: Fields) => {
    for (let i = 0; i < ms; i += 1) {
      vi.advanceTimersByTime(1);
      if (status && i % 50 === 49) state(status, fields);
    }
  };
  /** Return the messages of these types since the last call, without heartbeats. */
  const take = (...types: string[]) => {
    const taken = socket.sent.filter(({ t }) => !["heartbeat", "view"].includes(t));
    socket.sent = [];
    return types.length === 0 ? taken : taken.filter(({ t }) => types.includes(t));
  };
  socket.onopen();
  const welcome = { t: "welcome", operator: "ann", role: "operator", may_stop: true, robots: [] };
  say({ ...welcome, name: "", user: null, robot: null });
  say(ROBOT);
  state();
  pass(20);
  take();
  return { session, link, drive, socket, say, state, pass, take, welcome };
}

/** Dispatch an event with these fields, at the window without a target. */
export function fire(target: EventTarget | null, type: string, fields: object = {}): Event {
  const event = new Event(type, { bubbles: type !== "blur", cancelable: true });
  for (const [name, value] of Object.entries(fields))
    Object.defineProperty(event, name, { value, configurable: true });
  (target ?? window).dispatchEvent(event);
  return event;
}

export function press(target: EventTarget | null, code: string, fields: object = {}): Event {
  return fire(target, "keydown", { code, key: code, repeat: false, ...fields });
}

export function lift(target: EventTarget | null, code: string, fields: object = {}): Event {
  return fire(target, "keyup", { code, key: code, repeat: false, ...fields });
}

/** Give an element a place on the screen, in pixels. */
export function place(node: Element, width: number, height: number): void {
  const box = { left: 0, top: 0, width, height, right: width, bottom: height };
  node.getBoundingClientRect = () => box as DOMRect;
}
