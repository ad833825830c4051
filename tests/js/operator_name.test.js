import assert from "node:assert/strict";
import { test } from "node:test";

const { permitted } = await import("../../src/tsd_twin/dashboard/static/operator_name.js");

test("a typed name becomes one that the bus permits", () => {
  const permittedBus = /^[a-z0-9_][a-z0-9_-]{0,22}$/;
  const typed = ["Anna Müller", "  J. O'Neill!  ", "ÅSA", "x".repeat(99), "a".repeat(19) + " b"];
  for (const text of typed) assert.match(permitted(text), permittedBus, text);
  assert.equal(permitted("Anna Müller"), "anna-muller");
  assert.equal(permitted("田中"), "");
});
