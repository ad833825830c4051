// A session with a socket that the test answers.

import type { RobotInfo, RobotState, RouteState } from "../../src/generated/wire";
import { Session } from "../../src/session";
import { FakeSocket, openWindow } from "../support/fake_socket";
import { ROBOT, STATE, STATUS, WELCOME } from "../support/messages";

export { ROBOT } from "../support/messages";

export function route(phase: RouteState["phase"], number = 1): RouteState {
  return { number, phase, length_m: 1.5, time_s: 4.2, done_m: 0.4, off_mm: 3, why: null };
}

/** Open a session whose robot is ready and driven by this page. */
export function openSession(robot: RobotInfo = ROBOT) {
  openWindow();
  localStorage.clear();
  const session = new Session();
  session.link.open();
  const socket = FakeSocket.newest;
  const say = (message: object) => socket.say(message);
  let seq = 0;
  const state = (fields: Partial<RobotState> | object = {}, mode = "ready") =>
    say({
      ...STATE,
      status_seq: ++seq,
      pose: [1, 2, 0.5],
      status: { ...STATUS, mode },
      ...fields,
    });
  socket.onopen();
  const robots = [{ id: robot.id, title: robot.title, colour: "#1d96fe" }];
  say({ ...WELCOME, robots, robot: robot.id });
  say(robot);
  state();
  const take = (...types: string[]) => socket.take(...types);
  take();
  return { session, say, state, take };
}

export function press(code: string, type: "keydown" | "keyup" = "keydown"): void {
  document.body.dispatchEvent(new KeyboardEvent(type, { code, bubbles: true, cancelable: true }));
}
