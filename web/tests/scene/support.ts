// A session with a socket that the test answers.

import { vi } from "vitest";
import type { RobotInfo, RobotState, RouteState } from "../../src/generated/wire";
import { Session } from "../../src/session";

interface Sent {
  t: string;
  [field: string]: unknown;
}

class FakeSocket {
  static readonly OPEN = 1;
  static latest: FakeSocket;
  readonly readyState = 1;
  readonly bufferedAmount = 0;
  sent: Sent[] = [];
  onopen = () => {};
  onmessage = (_: { data: string }) => {};
  onclose = () => {};

  constructor() {
    FakeSocket.latest = this;
  }

  send(text: string): void {
    this.sent.push(JSON.parse(text) as Sent);
  }

  close(): void {}
}

export const ROBOT = {
  t: "robot",
  id: "tsd",
  title: "tsd",
  space: "floor",
  panel: "gimbals",
  twist_scale_m: 1,
  sideways: true,
  modules: ["1", "2", "3"],
  wheels: [],
  joints: [],
} as unknown as RobotInfo;

const STATUS = {
  mode: "ready",
  limits: { speed_mps: 2, turn_rate_rad_per_s: 4 },
  refusals: null,
  operators: {},
  lease: { holder: "ann" },
};

export function route(phase: RouteState["phase"], number = 1): RouteState {
  return { number, phase, length_m: 1.5, time_s: 4.2, done_m: 0.4, off_mm: 3, why: null };
}

const add = globalThis.addEventListener;
let listening = new AbortController();

/** End the listeners of the session before, which would take its keys first. */
function leavePage(): void {
  listening.abort();
  listening = new AbortController();
  const { signal } = listening;
  vi.stubGlobal("addEventListener", (type: string, listener: EventListener, options?: object) =>
    add(type, listener, { ...options, signal }),
  );
}

/** Open a session whose robot is ready and driven by this page. */
export function openSession(robot: RobotInfo = ROBOT) {
  leavePage();
  vi.stubGlobal("WebSocket", FakeSocket);
  localStorage.clear();
  const session = new Session();
  session.link.open();
  const socket = FakeSocket.latest;
  const say = (message: object) => socket.onmessage({ data: JSON.stringify(message) });
  let seq = 0;
  const state = (fields: Partial<RobotState> | object = {}, mode = "ready") =>
    say({
      t: "state",
      status_seq: ++seq,
      age_ms: 0,
      source: "robot",
      has_control: true,
      pose: [1, 2, 0.5],
      route: null,
      sphere: null,
      map: null,
      status: { ...STATUS, mode },
      ...fields,
    });
  socket.onopen();
  const robots = [{ id: robot.id, title: robot.title, colour: "#1d96fe" }];
  say({ t: "welcome", operator: "ann", role: "operator", may_stop: true, robots, robot: robot.id });
  say(robot);
  state();
  /** Messages of these types since the last call. */
  const take = (...types: string[]) => {
    const sent = socket.sent;
    socket.sent = [];
    return sent.filter(({ t }) => types.includes(t));
  };
  take();
  return { session, say, state, take };
}

export function press(code: string, type: "keydown" | "keyup" = "keydown"): void {
  document.body.dispatchEvent(new KeyboardEvent(type, { code, bubbles: true, cancelable: true }));
}
