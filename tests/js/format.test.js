import assert from "node:assert/strict";
import { test } from "node:test";

const { noticeOf, sentence, stopReason, withNames } =
  await import("../../src/tsd_twin/dashboard/static/format.js");
const { permitted } = await import("../../src/tsd_twin/dashboard/static/operator_name.js");

test("operators have their names, and pages without a name their numbers", () => {
  assert.equal(withNames("anna-8c30fedb asks bob-m-0123abcd."), "anna asks bob-m.");
  assert.equal(withNames("web-8c30fedb drives"), "web-8c30fedb drives");
  assert.equal(withNames("module2 is off by 0.12345678"), "module2 is off by 0.12345678");
});

test("a sentence begins with a capital, unless with the id of an operator", () => {
  assert.equal(sentence("anna-8c30fedb drives; ask for control"), "anna drives; ask for control.");
  assert.equal(sentence("web-8c30fedb drives"), "web-8c30fedb drives.");
  assert.equal(sentence("script has control now"), "script has control now.");
  assert.equal(sentence("the robot is arming"), "The robot is arming.");
  assert.equal(sentence("take control first"), "Take control first.");
});

test("a stop says who pressed it", () => {
  assert.equal(stopReason("software stop by web-8c30fedb", "web-8c30fedb"), "You pressed STOP.");
  assert.equal(stopReason("software stop by anna-8c30fedb", "web-1"), "anna stopped the robot.");
  assert.equal(stopReason("smoke", "web-1"), "Smoke.");
  assert.equal(stopReason("", undefined), "No reason given.");
});

test("a typed name becomes one that the bus permits", () => {
  const permittedBus = /^[a-z0-9_][a-z0-9_-]{0,22}$/;
  const typed = ["Anna Müller", "  J. O'Neill!  ", "ÅSA", "x".repeat(99), "a".repeat(19) + " b"];
  for (const text of typed) assert.match(permitted(text), permittedBus, text);
  assert.equal(permitted("Anna Müller"), "anna-muller");
  assert.equal(permitted("田中"), "");
});

test("a robot that comes to rest says once why, and what to do", () => {
  const event = {
    kind: "mode",
    text: "From driving to stopping: no command for 210 ms (limit 200 ms).",
  };
  assert.equal(
    noticeOf(event, false),
    "No command for 210 ms (limit 200 ms), so the robot stopped.",
  );
  const old = "the last command was based on a state 230 ms old (limit 210 ms)";
  assert.equal(
    noticeOf({ ...event, text: `From driving to stopping: ${old}.` }, true),
    `T${old.slice(1)}, so the robot stopped. Let go, then push again.`,
  );
  const lease = { kind: "lease", text: "bob-8c30fedb has control." };
  assert.equal(noticeOf(lease, true), "bob has control.");
});
