import { beforeEach, expect, test } from "vitest";
import { fakeBrowser, openPage, press, ROBOT } from "../support/page";

beforeEach(fakeBrowser);

test("a stop goes out when the socket is congested, before the release", () => {
  const { session, socket, take } = openPage();
  press(null, "KeyW");
  take();
  socket.bufferedAmount = 5000;
  session.stop.press();
  expect(take()).toEqual([{ t: "stop" }, { t: "release" }]);
});

test("a stop is repeated until the robot is stopped, with an alarm from 600 ms to then", () => {
  const { session, pass, state, take } = openPage();
  const { stop } = session;
  stop.press();
  expect(take("stop")).toHaveLength(1);
  pass(500);
  expect(stop.unconfirmed.value).toBe(false);
  pass(500);
  expect(take("stop").length).toBeGreaterThanOrEqual(3);
  expect(stop.unconfirmed.value).toBe(true);
  stop.press();
  expect(stop.unconfirmed.value).toBe(true);
  state({ mode: "stopped" });
  expect(stop.unconfirmed.value).toBe(false);
  take();
  pass(1000);
  expect(take("stop")).toEqual([]);
});

test.each(["recording", "several"] as const)(
  "no state of source %s confirms a stop, only the reply of the robots",
  (source) => {
    const { session, pass, say, state } = openPage();
    const { unconfirmed } = session.stop;
    state({}, { source });
    session.stop.press();
    pass(900, { mode: "stopped" }, { source });
    expect(unconfirmed.value).toBe(true);
    say({ t: "reply", to: "stop", ok: false, why: { code: "no_answer" } });
    expect(unconfirmed.value).toBe(true);
    say({ t: "reply", to: "stop", ok: true, why: null });
    expect(unconfirmed.value).toBe(false);
  },
);

test("the alarm of a stop outlasts its repetitions, and another robot does not end it", () => {
  const { session, pass, say, state, take } = openPage();
  const { stop } = session;
  stop.press();
  pass(6000);
  take();
  pass(1000);
  expect(take("stop")).toEqual([]);
  expect(stop.unconfirmed.value).toBe(true);
  say({ ...ROBOT, id: "bob" });
  state({ mode: "stopped" });
  expect(stop.unconfirmed.value).toBe(true);
  stop.acknowledge();
  expect(stop.unconfirmed.value).toBe(false);
});

test("a state in flight confirms no stop of a robot that was stopped before", () => {
  const { session, pass, state } = openPage();
  const { stop } = session;
  state({ mode: "stopped" });
  stop.press();
  state({ mode: "stopped" });
  pass(700);
  expect(stop.unconfirmed.value).toBe(true);
  for (let i = 0; i < 20; i += 1) state({ mode: "stopped" });
  expect(stop.unconfirmed.value).toBe(false);
});

test("a confirmed stop is not repeated", () => {
  const { session, pass, say, take } = openPage();
  session.stop.press();
  say({ t: "reply", to: "stop", ok: true, why: null });
  take();
  pass(1000);
  expect(take("stop")).toEqual([]);
});
