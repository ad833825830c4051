import { readFileSync } from "node:fs";
import { beforeEach, describe, expect, test } from "vitest";

import type { Reason, RobotEvent } from "../../src/generated/wire";
import { isNotable, isToldElsewhere, noticeOf, retry } from "../../src/text/notices";
import { nameOf, nameOperatorsBy, sentence, words } from "../../src/text/reasons";
import { language } from "../../src/text/text";
import type { Link } from "../../src/store/link";

interface Vector {
  reason: Reason;
  part: string;
  whole: string;
}

const FILE = `${import.meta.dirname}/../../../tests/messages/reasons.json`;
const VECTORS = JSON.parse(readFileSync(FILE, "utf-8")) as Vector[];

/** Name operators as a robot does that knows these names. */
function name(operators: Record<string, string>): void {
  nameOperatorsBy({ state: { value: { status: { operators } } } } as unknown as Link);
}

beforeEach(() => {
  language.value = "en";
  name({});
});

test.each(VECTORS)("$reason has the sentence that the robot makes", ({ reason, part, whole }) => {
  const ids = ["alice-0123abcd", "bob", "web-8c30fedb"];
  name(Object.fromEntries(ids.map((id) => [id, id])));
  const shown = (text: string) => text.replaceAll("-", "−"); // The page has the longer minus.
  expect(shown(words(reason))).toBe(shown(part));
  expect(shown(sentence(reason))).toBe(shown(whole));
});

test("operators have their names, and guests, who have none, the number of their page", () => {
  expect(nameOf("bob-m-0123abcd")).toBe("bob-m");
  expect(nameOf("web-8c30fedb")).toBe("Guest 8C30");
  const params = { operator: "anna-8c30fedb", holder: "bob-m-0123abcd" };
  expect(sentence({ code: "control_requested", params })).toBe("anna asks bob-m for control.");
  name({ "anna-8c30fedb": "Анна" });
  expect(sentence({ code: "control_requested", params })).toBe("Анна asks bob-m for control.");
});

test("a name written from right to left does not turn the sentence around", () => {
  name({ bob: "محمد" });
  const reason = { code: "held_by", params: { holder: "bob" } };
  expect(sentence(reason)).toBe("\u2068محمد\u2069 has control.");
});

test("German figures have a decimal comma, and thousands points", () => {
  language.value = "de";
  const low = { code: "battery_too_low", params: { volts: 10.5 } };
  expect(sentence(low)).toContain("10,5 V");
  const rpm = { code: "wheel_speed_refused", params: { least_rpm: 500, most_rpm: 4000 } };
  expect(sentence(rpm)).toContain("500 bis 4.000 U/min");
});

const STOPS: Reason = { code: "mode_changed", params: { before: "driving", after: "stopping" } };
const NO_COMMAND: Reason = { code: "no_command", params: { ms: 210, limit_ms: 200 } };

function eventOf(kind: string, why: Reason): RobotEvent {
  return { t: "event", kind, why, past: false, age_s: 0 };
}

describe("notices", () => {
  test("a robot that comes to rest says once why, and what to do", () => {
    const event = eventOf("mode", { ...STOPS, cause: NO_COMMAND });
    const said = "No command for 210 ms (limit 200 ms), so the robot stopped.";
    expect(noticeOf(event, false).text).toBe(said);
    const toDriver = noticeOf(event, true);
    expect(toDriver).toMatchObject({ text: `${said} Let go, then push again.`, again: true });
    const lease = eventOf("lease", { code: "lease_granted", params: { operator: "bob" } });
    expect(noticeOf(lease, true).text).toBe("bob has control.");
  });

  test("a robot that disarms itself says what that means", () => {
    const params = { before: "ready", after: "disarmed" };
    const cause = { code: "unattended", params: { s: 10 } };
    const { text } = noticeOf(eventOf("mode", { code: "mode_changed", params, cause }), false);
    expect(text).toBe("No operator has had control for 10 s, so the motors are off.");
  });

  test("without control, pushing again does not help", () => {
    expect(retry({ code: "take_control_first" }).text).toBe("Take control first.");
    const event = eventOf("mode", { ...STOPS, cause: { code: "control_lost" } });
    expect(noticeOf(event, true).again).toBe(false);
  });

  test("only a stop, a loss of control and a robot at rest are told elsewhere", () => {
    expect(isToldElsewhere({ code: "mode_only", params: { mode: "fault" } })).toBe(true);
    expect(isToldElsewhere({ code: "mode_only", params: { mode: "arming" } })).toBe(false);
    expect(isToldElsewhere({ code: "stop_pressed" })).toBe(true);
    expect(isToldElsewhere({ code: "no_such_code" })).toBe(false);
  });

  test.each<[string, Reason, boolean]>([
    ["id", { code: "duplicate_id", params: { robot: "tsd" } }, true],
    ["lease", { code: "control_requested", params: { operator: "bob", holder: "ann" } }, false],
    ["lease", { code: "control_requested", params: { operator: "ann", holder: "bob" } }, false],
    ["lease", { code: "control_requested", params: { operator: "bob", holder: "carol" } }, true],
    ["lease", { code: "lease_granted", params: { operator: "ann" } }, false],
    ["lease", { code: "lease_granted", params: { operator: "bob" } }, true],
    ["consistency", { code: "actuator_suspect", params: { actuator: "module2" } }, true],
    ["lease", { code: "lease_taken_over", params: { operator: "ann", other: "bob" } }, true],
    ["lease", { code: "lease_expired", params: { operator: "ann" } }, true],
    ["lease", { code: "control_is_lost", cause: { code: "lease_ended" } }, true],
    ["mode", { ...STOPS, cause: { code: "control_lost" } }, true],
    ["mode", { ...STOPS, cause: { code: "disarmed_by_operator" } }, false],
    ["mode", STOPS, false],
    ["mode", { code: "mode_changed", params: { before: "stopping", after: "ready" } }, false],
  ])("of %s, %j is told: %s", (kind, why, told) => {
    expect(isNotable(eventOf(kind, why), "ann")).toBe(told);
  });
});
