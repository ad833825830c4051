import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";

import * as permission from "../../src/store/permission";
import type { Link } from "../../src/store/link";
import { refusalText } from "../../src/text/reasons";
import { language } from "../../src/text/text";
import { type FakePage, ME, openPage } from "../support/fake_page";

const HELD = {
  arm: (link: Link) => permission.whyNot(link, "arm"),
  disarm: (link: Link) => permission.whyNot(link, "disarm"),
  reset: (link: Link) => permission.whyNot(link, "reset"),
  speed: (link: Link) => permission.whyNot(link, "speed"),
  drive: permission.whyNotDrive,
};
const LOOSE = { code: "hardware", params: { text: "the wheels are loose" } };
const HELD_BY_BOB = { code: "held_by", params: { holder: "bob" } };

let page: FakePage;
beforeEach(async () => {
  language.value = "en";
  page = await openPage();
});
afterEach(() => vi.useRealTimers());

type Check = (link: Link) => permission.Refusal | null;

function reason(check: Check): string | null {
  const refusal = check(page.session.link);
  return refusal && refusalText(refusal);
}

const refusals = (why: Record<string, unknown> = {}) => ({ why });

describe.each(Object.entries(HELD))("%s", (request, check) => {
  test("is refused with the sentence of the robot, or not at all", () => {
    page.state({ refusals: refusals() });
    expect(reason(check)).toBeNull();
    page.state({ refusals: refusals({ [request]: LOOSE }) });
    expect(reason(check)).toBe("The wheels are loose.");
  });

  test("needs control, and the robot says who has it", () => {
    page.state({ lease: { holder: "bob" }, refusals: refusals({ no_lease: HELD_BY_BOB }) });
    expect(reason(check)).toBe("bob has control.");
  });

  test("is refused by a lost link before by what the robot said last", () => {
    page.state({ refusals: refusals({ [request]: LOOSE }) });
    page.pass(1000);
    expect(reason(check)).toBe("The robot is silent.");
    page.disconnect();
    expect(reason(check)).toBe("No connection to the dashboard.");
  });

  test.each([null, {}])("of a robot that sends refusals %j needs control only", (refusals) => {
    page.state({ refusals });
    expect(reason(check)).toBeNull();
    page.state({ refusals, lease: { holder: "bob" } });
    expect(reason(check)).toBe("Take control first.");
  });

  test("of a replay is refused", () => {
    page.state({ refusals: refusals(), state: { source: "recording" } });
    expect(reason(check)).toBe("This is a replay of a recording: it cannot be driven.");
  });

  test("of viewers is refused", () => {
    page.say({ t: "welcome", operator: ME, role: "viewer", robots: [], robot: "tsd" });
    page.state({ lease: { holder: "bob" } });
    expect(reason(check)).toBe("You may look, not drive.");
  });
});

test.each([refusals(), null])(
  "a robot that comes to rest is not moved, refusals %j",
  (refusals) => {
    page.state({ mode: "stopping", refusals });
    expect(reason(permission.whyNotDrive)).toBe("The robot is stopping.");
  },
);

test("a path is planned in every mode that is not latched", () => {
  page.state({ mode: "disarmed", refusals: refusals({ drive: { code: "arm_first" } }) });
  expect(reason(permission.whyNotPlan)).toBeNull();
  const drive = { code: "reset_first", params: { mode: "stopped" } };
  page.state({ mode: "stopped", refusals: refusals({ drive }) });
  expect(reason(permission.whyNotPlan)).toBe("The robot is stopped: reset first.");
  page.state({ mode: "stopped" });
  expect(reason(permission.whyNotPlan)).toBe("The robot is stopped.");
});

test("control can be taken or asked for unless it is kept for another operator", () => {
  const lease = { code: "reserved_for", params: { operator: "bob" } };
  const kept = (reserved_for: string | null) =>
    page.state({ lease: { holder: null, reserved_for }, refusals: refusals({ lease }) });
  page.state({ lease: { holder: null }, refusals: refusals() });
  expect(reason(permission.whyNotTakeControl)).toBeNull();
  page.state({ lease: { holder: "bob" }, refusals: refusals({ lease: HELD_BY_BOB }) });
  expect(reason(permission.whyNotTakeControl)).toBeNull();
  kept("bob");
  expect(reason(permission.whyNotTakeControl)).toBe("Control is kept for bob, for a moment.");
  kept(ME);
  expect(reason(permission.whyNotTakeControl)).toBeNull();
});
