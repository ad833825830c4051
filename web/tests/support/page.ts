// A page with its session, and the other ends of it: server, pointers, keys and the clock.

import { vi } from "vitest";
import type { RobotState } from "../../src/generated/wire";
import { Session } from "../../src/session";
import { nameOperatorsBy } from "../../src/text/reasons";
import { FakeSocket, openWindow } from "./fake_socket";
import { ROBOT, STATE, STATUS, WELCOME } from "./messages";

export { LEASE, ROBOT } from "./messages";

type Fields = Partial<Omit<RobotState, "status">>;

/** Use fake timers and sockets in a test file; call it in `beforeEach`. */
export function fakeBrowser(): void {
  vi.useFakeTimers();
  localStorage.clear();
  document.body.innerHTML = "";
  openWindow();
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
  const socket = FakeSocket.newest;
  const say = (message: object) => socket.say(message);
  let seen = 0;
  /** Send a state; the fields of `status` replace those of a robot that is ready. */
  const state = (status: object = {}, fields: Fields = {}) =>
    say({
      ...STATE,
      status_seq: (seen += 1),
      ...fields,
      status: { ...STATUS, operators: { bob: "Bob" }, ...status },
    });
  /** Let time pass; a robot that is not silent sends a state every 50 ms. */
  const pass = (ms: number, status?: object, fields?: Fields) => {
    for (let i = 0; i < ms; i += 1) {
      vi.advanceTimersByTime(1);
      if (status && i % 50 === 49) state(status, fields);
    }
  };
  const take = (...types: string[]) => socket.take(...types);
  socket.onopen();
  const welcome = { ...WELCOME, robots: [], robot: null };
  say(welcome);
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
