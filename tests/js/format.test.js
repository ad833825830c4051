import assert from "node:assert/strict";
import { test } from "node:test";

const { sentence, stopReason, withNames } =
  await import("../../src/tsd_twin/dashboard/static/format.js");
const { permitted } = await import("../../src/tsd_twin/dashboard/static/operator_name.js");

test("operators have their names, and pages without a name their numbers", () => {
  assert.equal(withNames("anna-8c30fedb asks bob-m-0123abcd."), "anna asks bob-m.");
  assert.equal(withNames("web-8c30fedb drives"), "web-8c30fedb drives");
  assert.equal(withNames("module2 is off by 0.12345678"), "module2 is off by 0.12345678");
  assert.equal(sentence("anna-8c30fedb drives; ask for control"), "Anna drives; ask for control.");
  assert.equal(sentence("web-8c30fedb drives"), "Web-8c30fedb drives.");
});

test("a stop says who pressed it", () => {
  assert.equal(stopReason("software stop by web-8c30fedb", "web-8c30fedb"), "You pressed STOP.");
  assert.equal(stopReason("software stop by anna-8c30fedb", "web-1"), "Anna stopped the robot.");
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
