import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";

import type { Reason } from "../../src/generated/wire";
import { language } from "../../src/text/text";
import { type FakePage, ME, openPage } from "../support/fake_page";
import { ROBOT } from "../support/messages";

let page: FakePage;

beforeEach(async () => {
  sessionStorage.clear();
  language.value = "en";
  page = await openPage();
  page.state();
});
afterEach(() => {
  dispatchEvent(new Event("blur"));
  vi.useRealTimers();
});

const told = () => page.session.notice.text.value;
const key = (type: "keydown" | "keyup") =>
  dispatchEvent(new KeyboardEvent(type, { code: "KeyW", key: "w" }));
const event = (kind: string, why: Reason, past = false) =>
  page.say({ t: "event", kind, text: "", why, past, robot_s: 1, age_s: 0 });

const SLOW: Reason = {
  code: "mode_changed",
  params: { before: "driving", after: "stopping" },
  cause: { code: "no_command", params: { ms: 210, limit_ms: 200 } },
};
const STALLED = { t: "released", why: { code: "page_stalled", params: { s: 0.2 } } };
const BY_ROBOT = "No command for 210 ms (limit 200 ms), so the robot stopped.";
const BY_PAGE = "Your page stalled for 0.2 s, so the robot stopped.";
const AGAIN = "Let go, then push again.";

describe("the end of a motion", () => {
  test.each([
    [BY_ROBOT, [() => event("mode", SLOW), () => page.say(STALLED)]],
    [BY_PAGE, [() => page.say(STALLED), () => event("mode", SLOW)]],
  ])("is told once, by the first to tell: %s", (first, messages) => {
    key("keydown");
    for (const message of messages) message();
    expect(told()).toBe(`${first} ${AGAIN}`);
  });

  test("is no longer told once the robot drives again", () => {
    key("keydown");
    page.say(STALLED);
    key("keyup");
    page.pass(500);
    page.state();
    expect(told()).toContain(AGAIN);
    key("keydown");
    expect(told()).toBeNull();
    expect(page.sent("drive").length).toBeGreaterThan(1);
  });

  test("gives no advice beside a latched stop", () => {
    key("keydown");
    page.say(STALLED);
    page.state({ mode: "stopped" });
    page.pass(2500);
    expect(told()).toBeNull();
  });

  test("by the robot gives no advice beside a latched stop either", () => {
    page.state({ mode: "driving" });
    event("mode", SLOW);
    expect(told()).toBe(`${BY_ROBOT} ${AGAIN}`);
    page.state({ mode: "stopped" });
    page.pass(2500);
    expect(told()).toBeNull();
  });

  test.each<[Reason, string | null]>([
    [
      { code: "page_silent", params: { s: 1 } },
      "Your page was silent for 1 s, so it lost control: take it again.",
    ],
    [{ code: "stop_pressed" }, null],
    [{ code: "control_is_lost", cause: { code: "lease_ended" } }, null],
    [{ code: "reset_first", params: { mode: "stopped" } }, null],
    [{ code: "mode_only", params: { mode: "stopping" } }, null],
    [{ code: "stopped_by_itself" }, null],
  ])("by the server, $code, is told unless another part of the page tells it", (why, text) => {
    key("keydown");
    page.say({ t: "released", why });
    expect(told()).toBe(text);
  });

  test("by the loss of control is told, without advice to push again", () => {
    key("keydown");
    page.state({ lease: { holder: "bob" } });
    expect(told()).toBe("Take control first.");
  });

  test("is not told by a page that holds nothing", () => {
    page.say(STALLED);
    expect(told()).toBeNull();
  });

  test("by a robot that falls silent is told while it is silent", () => {
    key("keydown");
    page.pass(600);
    expect(told()).toBe(`The robot is silent. ${AGAIN}`);
    page.pass(1800);
    page.state();
    page.pass(100);
    expect(told()).toBeNull();
  });

  test("by a lost connection is told while it is lost", () => {
    key("keydown");
    page.disconnect();
    expect(told()).toBe("The connection is lost.");
  });
});

test("a control that cannot begin says why, without advice to push again", () => {
  const why = { drive: { code: "arm_first" }, no_lease: { code: "no_operator" } };
  page.state({ mode: "disarmed", refusals: { why } });
  key("keydown");
  expect(told()).toBe("The robot is disarmed: arm it first.");
});

test("a take-over is told once with its reason", () => {
  const params = { operator: "bob", other: ME, text: "it is my robot" };
  const said = "bob took control over from Guest 0000: it is my robot.";
  event("lease", { code: "lease_taken_over", params });
  event("lease", { code: "control_is_lost", cause: { code: "lease_ended" } });
  event("mode", { ...SLOW, cause: { code: "control_lost" } });
  expect(told()).toBe(said);
  page.pass(1100);
  event("lease", { code: "control_is_lost", cause: { code: "lease_ended" } });
  expect(told()).toBe("Control is lost: the lease has ended.");
});

test("events of the past are told by nobody", () => {
  event("mode", SLOW, true);
  expect(told()).toBeNull();
});

describe("requests", () => {
  const LOOSE = { code: "hardware", params: { text: "the wheels are loose" } };

  test("that are refused say why", () => {
    page.session.requests.send({ t: "arm" });
    page.say({ t: "reply", to: "arm", ok: false, why: LOOSE });
    expect(told()).toBe("The wheels are loose.");
  });

  test("without an answer say so", () => {
    page.session.requests.send({ t: "arm" });
    page.pass(2500);
    expect(told()).toBe("The robot does not answer.");
  });

  test("of other kinds are answered too, but not a stop, which its button shows", () => {
    page.say({ t: "reply", to: "stop", ok: false, why: LOOSE });
    expect(told()).toBeNull();
    page.say({ t: "reply", to: "plan", ok: false, why: null });
    expect(told()).toBe("The request was refused.");
  });
});

test("a viewer who may not stop is told so", () => {
  page.say({ ...{ t: "welcome", operator: ME, robots: [], robot: "tsd" }, may_stop: false });
  page.session.stop.press();
  expect(told()).toBe("You may look, not stop.");
  expect(page.sent("stop")).toEqual([]);
});

test("of another robot, no notice is true", () => {
  page.session.requests.send({ t: "arm" });
  page.say({ t: "reply", to: "arm", ok: false, why: { code: "at_rest_only" } });
  expect(told()).not.toBeNull();
  page.say({ ...ROBOT, id: "kiwi" });
  expect(told()).toBeNull();
});

test("a page that is loaded again in motion says why the robot stopped, once", async () => {
  page.state({ mode: "driving" });
  dispatchEvent(new Event("pagehide"));
  page = await openPage();
  expect(told()).toContain("so the robot stopped");
  page.say({ ...ROBOT });
  expect(told()).toBeNull();
  page.state({ mode: "ready" });
  page = await openPage();
  expect(told()).toBeNull();
});
