import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

const {
  retryNotice,
  isNotable,
  isToldElsewhere,
  keyOf,
  nameOf,
  noticeOf,
  sentence,
  stopReason,
  words,
} = await import("../../src/tsd_twin/dashboard/static/reasons.js");

const VECTORS = JSON.parse(
  readFileSync(new URL("../messages/reasons.json", import.meta.url), "utf-8"),
);
const same = (operator) => operator;

for (const { reason, part, whole } of VECTORS) {
  test(`${JSON.stringify(reason)} has the sentence that the robot makes`, () => {
    assert.equal(words(reason, same), part);
    assert.equal(sentence(reason, same), whole);
  });
}

test("operators have their names, and pages without a name their numbers", () => {
  assert.equal(nameOf("bob-m-0123abcd"), "bob-m");
  assert.equal(nameOf("web-8c30fedb"), "web-8c30fedb");
  const asked = { operator: "anna-8c30fedb", holder: "bob-m-0123abcd" };
  const reason = { code: "control_requested", params: asked };
  assert.equal(sentence(reason), "anna asks bob-m for control.");
});

test("a stop says who pressed it", () => {
  const stop = (by) => ({ code: "stop_requested", params: { by } });
  assert.equal(stopReason(stop("web-8c30fedb"), "web-8c30fedb"), "You pressed STOP.");
  assert.equal(stopReason(stop("anna-8c30fedb"), "web-1"), "anna stopped the robot.");
  const smoke = { code: "stop_with_text", params: { by: "bob", text: "smoke" } };
  assert.equal(stopReason(smoke, "web-1"), "Smoke.");
  assert.equal(stopReason(null, undefined), "No reason given.");
});

const STOPS = { code: "mode_changed", params: { before: "driving", after: "stopping" } };

test("a robot that comes to rest says once why, and what to do", () => {
  const cause = { code: "no_command", params: { ms: 210, limit_ms: 200 } };
  const event = { kind: "mode", why: { ...STOPS, cause } };
  const said = "No command for 210 ms (limit 200 ms), so the robot stopped.";
  assert.equal(noticeOf(event, false).text, said);
  assert.equal(noticeOf(event, true).text, `${said} Let go, then push again.`);
  assert.equal(noticeOf(event, true).again, true);
  const lease = { kind: "lease", why: { code: "lease_granted", params: { operator: "bob" } } };
  assert.equal(noticeOf(lease, true).text, "bob has control.");
});

test("without control, pushing again does not help", () => {
  assert.equal(retryNotice({ code: "take_control_first" }).text, "Take control first.");
  const cause = { code: "control_lost" };
  assert.equal(noticeOf({ kind: "mode", why: { ...STOPS, cause } }, true).again, false);
});

test("the same reason with other numbers is shown once", () => {
  const stalled = (s) => ({ code: "page_stalled", params: { s } });
  assert.equal(keyOf(stalled(0.2)), keyOf(stalled(0.3)));
  const held = (holder) => ({ code: "held_by", params: { holder } });
  assert.notEqual(keyOf(held("ann")), keyOf(held("bob")));
});

test("only a stop, a loss of control and a robot at rest are told elsewhere", () => {
  assert.equal(isToldElsewhere({ code: "mode_only", params: { mode: "fault" } }), true);
  assert.equal(isToldElsewhere({ code: "mode_only", params: { mode: "arming" } }), false);
  assert.equal(isToldElsewhere({ code: "no_such_code" }), false);
});

for (const [kind, why, notable] of [
  ["id", { code: "duplicate_id", params: { robot: "tsd" } }, true],
  ["lease", { code: "control_requested", params: { operator: "bob", holder: "ann" } }, false],
  ["lease", { code: "control_requested", params: { operator: "ann", holder: "bob" } }, false],
  ["lease", { code: "control_requested", params: { operator: "bob", holder: "carol" } }, true],
  ["lease", { code: "lease_granted", params: { operator: "ann" } }, false],
  ["lease", { code: "lease_granted", params: { operator: "bob" } }, true],
  ["lease", { code: "lease_taken_over", params: { operator: "ann", other: "bob" } }, true],
  ["lease", { code: "lease_expired", params: { operator: "ann" } }, true],
  ["lease", { code: "control_is_lost", cause: { code: "lease_ended" } }, true],
  ["mode", { ...STOPS, cause: { code: "control_lost" } }, true],
  ["mode", { ...STOPS, cause: { code: "disarmed_by_operator" } }, false],
  ["mode", STOPS, false],
  ["mode", { code: "mode_changed", params: { before: "stopping", after: "ready" } }, false],
]) {
  test(`${kind} ${JSON.stringify(why)} is ${notable ? "" : "not "}worth a notice`, () => {
    assert.equal(isNotable({ kind, why }, "ann"), notable);
  });
}
