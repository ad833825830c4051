import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { fire, keyUp, openPage, pass } from "./browser.js";

openPage();
const { LongPressButton, tooltip } = await import("../../src/tsd_twin/dashboard/static/button.js");

function made() {
  openPage();
  const calls = [];
  mock.method(tooltip, "show", (_, text) => calls.push(text()));
  const button = new LongPressButton("Reset", () => calls.push("pressed"), {});
  return { button, calls, node: button.button };
}

test("a long press acts after a second, and not when it ends before", () => {
  const { calls, node } = made();
  fire(node, "pointerdown", { button: 0 });
  pass(900);
  fire(node, "pointerup");
  pass(1000);
  assert.deepEqual(calls, []);
  fire(node, "pointerdown", { button: 0 });
  pass(1000);
  assert.deepEqual(calls, ["pressed"]);
});

test("a refusal is shown at once, and a press that outlasts it acts", () => {
  const { button, calls, node } = made();
  button.setDisabledReason("Let go of the stick first.");
  fire(node, "pointerdown", { button: 0 });
  assert.deepEqual(calls, ["Let go of the stick first."]);
  pass(400);
  button.setDisabledReason(null);
  pass(600);
  assert.deepEqual(calls, ["Let go of the stick first.", "pressed"]);
});

test("a long press that is still refused when it ends does not act", () => {
  const { button, calls, node } = made();
  fire(node, "pointerdown", { button: 0 });
  button.setDisabledReason("Take control first.");
  pass(1000);
  assert.deepEqual(calls, ["Take control first."]);
});

test("what follows a long press waits until its key has come up, which would press that too", () => {
  const { button } = made();
  const then = mock.fn();
  button.key({ code: "Enter", type: "keydown", repeat: false });
  button.whenReleased(then);
  pass(100);
  assert.equal(then.mock.callCount(), 0);
  keyUp("Enter");
  keyUp("Enter");
  assert.equal(then.mock.callCount(), 1);
  button.whenReleased(then);
  assert.equal(then.mock.callCount(), 2);
});
