// The parts of a browser that the controls of the page use: event targets, a clock, a socket, gamepads.

import { mock } from "node:test";

let page = new EventTarget();
let nowMs = 0;

/** An element that takes focus and captures pointers. */
export class FakeElement extends EventTarget {
  captured = new Set();

  focus() {}

  getRootNode() {
    return { activeElement: this };
  }

  getBoundingClientRect() {
    return { left: 0, top: 0, width: 100, height: 100 };
  }

  setPointerCapture(pointer) {
    this.captured.add(pointer);
  }

  hasPointerCapture(pointer) {
    return this.captured.has(pointer);
  }

  releasePointerCapture(pointer) {
    this.captured.delete(pointer);
    fire(this, "lostpointercapture", { pointerId: pointer });
  }
}

/** An element that was made by a script of the page: attributes, text and style. */
class MadeElement extends FakeElement {
  attributes = new Map();
  textContent = "";
  style = { setProperty() {} };
  classList = { add() {} };

  append() {}

  toggleAttribute(name, force) {
    if (force) this.setAttribute(name, "");
    else this.removeAttribute(name);
  }

  setAttribute(name, value) {
    this.attributes.set(name, value);
  }

  getAttribute(name) {
    return this.attributes.get(name) ?? null;
  }

  removeAttribute(name) {
    this.attributes.delete(name);
  }
}

class Field extends FakeElement {
  type = "text";
  inputMode = "";
  readOnly = false;
  clicks = 0;

  click() {
    this.clicks += 1;
  }
}

/** WebSocket that records sent messages as objects. */
class Socket {
  static OPEN = 1;
  static newest = null;
  readyState = Socket.OPEN;
  bufferedAmount = 0;
  sent = [];

  constructor(address) {
    this.address = new URL(address);
    Socket.newest = this;
  }

  send(text) {
    this.sent.push(JSON.parse(text));
  }

  close() {
    this.readyState = 3;
  }
}

Object.assign(globalThis, {
  addEventListener: (...args) => page.addEventListener(...args),
  window: { tsd: { hasFocus: () => true } },
  location: { href: "http://localhost/", protocol: "http:" },
  WebSocket: Socket,
  Node: FakeElement,
  HTMLElement: FakeElement,
  HTMLInputElement: Field,
  HTMLButtonElement: MadeElement,
  HTMLTextAreaElement: class extends FakeElement {},
  HTMLSelectElement: class extends FakeElement {},
});
let pads = [];
Object.defineProperty(globalThis, "navigator", { value: { getGamepads: () => pads } });
mock.method(performance, "now", () => nowMs);

/** Open a new page: no listeners, timers or gamepads are left of the last one. */
export function openPage() {
  page = new EventTarget();
  globalThis.document = Object.assign(new EventTarget(), {
    visibilityState: "visible",
    createElement: () => new MadeElement(),
  });
  pads = [];
  mock.timers.reset();
  mock.timers.enable({ apis: ["setInterval", "setTimeout"] });
}

/** Advance time by `ms` and run due timers. */
export function pass(ms) {
  for (let i = 0; i < ms; i += 1) {
    nowMs += 1;
    mock.timers.tick(1);
  }
}

/** Let time pass in which no script runs, as while a page compiles what it draws with. */
export function stall(ms) {
  nowMs += ms;
}

/** Dispatch an event with these fields at a target, the window without one. */
export function fire(target, type, fields = {}) {
  const event = Object.assign(new Event(type, { cancelable: true }), fields);
  (target ?? page).dispatchEvent(event);
  return event;
}

export function keyDown(code, fields = {}) {
  return fire(null, "keydown", { code, repeat: false, ...fields });
}

export function keyUp(code) {
  return fire(null, "keyup", { code, repeat: false });
}

export function plugIn(pad) {
  pads[pad.index] = pad;
  fire(null, "gamepadconnected", { gamepad: pad });
}

export function unplug(pad) {
  pads[pad.index] = null;
  fire(null, "gamepaddisconnected", { gamepad: pad });
}

/** A gamepad with its sticks at rest. */
export function gamepad(axes = [0, 0, 0]) {
  return { index: 0, connected: true, axes, buttons: [{ pressed: false }, { pressed: false }] };
}

export function field(properties = {}) {
  return Object.assign(new Field(), properties);
}

export function button() {
  return new MadeElement();
}

const { Link } = await import("../../src/tsd_twin/dashboard/static/link.js");

const ROBOT = { t: "robot", id: "tsd", panel: "gimbals", twist_scale_m: 1 };
const STATE = {
  t: "state",
  status_seq: 1,
  age_ms: 0,
  source: "robot",
  has_control: true,
  status: { mode: "ready", limits: { speed_mps: 2, turn_rate_rad_per_s: 4 } },
};

/** On a new page, a link to a robot that is ready to be driven by it, and its server's side. */
export function connect() {
  openPage();
  const link = new Link("page");
  link.open();
  const socket = Socket.newest;
  socket.onopen();
  const say = (message) => socket.onmessage({ data: JSON.stringify(message) });
  let seen = 0;
  /** Send a state; the fields of `status` replace those of a robot that is ready. */
  const state = (status = {}, fields = {}) =>
    say({ ...STATE, status_seq: (seen += 1), ...fields, status: { ...STATE.status, ...status } });
  say({ t: "welcome", operator: "ann", role: "operator", may_stop: true, robots: [], robot: null });
  say(ROBOT);
  state();
  /** Return the messages of these types since the last call, without heartbeats. */
  const take = (...types) => {
    const taken = socket.sent.filter(({ t }) => t !== "heartbeat");
    socket.sent = [];
    return types.length === 0 ? taken : taken.filter(({ t }) => types.includes(t));
  };
  take();
  return { link, socket, say, state, take, newestSocket: () => Socket.newest };
}
