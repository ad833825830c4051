import assert from "node:assert/strict";
import { test } from "node:test";

import { FakeElement, fire, keyUp } from "./browser.js";

const { HoldToRunButton, KeyState, PointerCapture, SpringControl } =
  await import("../../src/tsd_twin/dashboard/static/held_controls.js");

const down = (code, repeat = false) => ({ type: "keydown", code, repeat });
const up = (code) => ({ type: "keyup", code, repeat: false });
const MEANINGS = { KeyW: [1, 0], KeyS: [-1, 0], KeyA: [0, 1] };

test("a key is held from its first key-down event to its key-up event", () => {
  const keys = new KeyState();
  assert.equal(keys.take(down("KeyW")), true);
  assert.equal(keys.take(down("KeyW", true)), false);
  assert.equal(keys.take(down("KeyW")), false);
  assert.equal(keys.size, 1);
  assert.equal(keys.take(up("KeyW")), true);
  assert.equal(keys.take(up("KeyW")), false);
  assert.equal(keys.size, 0);
});

test("a repeat does not begin a hold", () => {
  const keys = new KeyState();
  assert.equal(keys.take(down("KeyW", true)), false);
  assert.equal(keys.size, 0);
});

test("a key that the page released counts only after its key-up event, also without a repeat mark", () => {
  const keys = new KeyState();
  keys.take(down("KeyW"));
  keys.cancel();
  assert.equal(keys.size, 0);
  assert.equal(keys.take(down("KeyW", true)), false);
  assert.equal(keys.take(down("KeyW")), false);
  assert.equal(keys.size, 0);
  assert.equal(keys.take(up("KeyW")), false);
  assert.equal(keys.take(down("KeyW")), true);
});

test("a key that was not held when the page released the others counts at once", () => {
  const keys = new KeyState();
  keys.take(down("KeyW"));
  keys.cancel();
  assert.equal(keys.take(down("KeyA")), true);
});

test("opposite keys cancel each other, keys of two directions add up", () => {
  const keys = new KeyState();
  assert.deepEqual(keys.sum(MEANINGS, 2), [0, 0]);
  keys.take(down("KeyW"));
  keys.take(down("KeyA"));
  assert.deepEqual(keys.sum(MEANINGS, 2), [1, 1]);
  keys.take(down("KeyS"));
  assert.deepEqual(keys.sum(MEANINGS, 2), [0, 1]);
  keys.take(up("KeyW"));
  assert.deepEqual(keys.sum(MEANINGS, 2), [-1, 1]);
});

const FINGER = { pointerId: 7, button: 0, clientX: 50, clientY: 25 };

function captured() {
  const node = new FakeElement();
  const calls = [];
  const capture = new PointerCapture(node, {
    came: () => calls.push("came"),
    moved: () => calls.push("moved"),
    gone: () => calls.push("gone"),
  });
  return { node, calls, capture };
}

test("a pointer is captured from pointerdown on", () => {
  const { node, calls, capture } = captured();
  fire(node, "pointerdown", FINGER);
  assert.ok(capture.down && node.hasPointerCapture(7));
  fire(node, "pointermove", FINGER);
  assert.deepEqual(calls, ["came", "moved"]);
});

for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
  test(`${end} of the captured pointer ends the hold, once`, () => {
    const { node, calls, capture } = captured();
    fire(node, "pointerdown", FINGER);
    fire(node, end, { pointerId: 8 });
    assert.ok(capture.down);
    fire(node, end, FINGER);
    fire(node, "lostpointercapture", FINGER);
    assert.equal(capture.down, false);
    assert.deepEqual(calls, ["came", "gone"]);
  });
}

test("a second pointer and a second mouse button do not take the control", () => {
  const { node, calls } = captured();
  fire(node, "pointerdown", { ...FINGER, button: 2 });
  assert.deepEqual(calls, []);
  fire(node, "pointerdown", FINGER);
  fire(node, "pointerdown", { ...FINGER, pointerId: 8 });
  fire(node, "pointermove", { ...FINGER, pointerId: 8 });
  assert.deepEqual(calls, ["came"]);
});

test("what a cancelled pointer still does is ignored until it comes down again", () => {
  const { node, calls, capture } = captured();
  fire(node, "pointerdown", FINGER);
  capture.cancel();
  assert.equal(capture.down, false);
  assert.equal(node.hasPointerCapture(7), false);
  fire(node, "pointermove", FINGER);
  fire(node, "pointerup", FINGER);
  assert.deepEqual(calls, ["came"]);
  fire(node, "pointerdown", FINGER);
  assert.deepEqual(calls, ["came", "came"]);
});

function spring() {
  const node = new FakeElement();
  const at = [0, 0];
  let changes = 0;
  class Spring extends SpringControl {
    place(right, up) {
      at.splice(0, 2, right, up);
    }
  }
  const control = new Spring(node, 0, () => (changes += 1));
  return { node, at, control, changes: () => changes };
}

test("a spring-centred control follows the pointer and returns to the centre on release", () => {
  const { node, at, control, changes } = spring();
  fire(node, "pointerdown", FINGER);
  assert.ok(control.held);
  assert.deepEqual(at, [0, 0.5]);
  fire(node, "pointermove", { ...FINGER, clientX: 100 });
  assert.deepEqual(at, [1, 0.5]);
  fire(node, "pointerup", FINGER);
  assert.equal(control.held, false);
  assert.deepEqual(at, [0, 0]);
  assert.equal(changes(), 3);
});

test("a spring-centred control drops its arrow keys when it loses the focus", () => {
  const { node, at, control, changes } = spring();
  assert.equal(control.key({ type: "keydown", code: "ArrowUp", repeat: false }), true);
  assert.equal(control.key({ type: "keydown", code: "KeyX", repeat: false }), false);
  assert.ok(control.held);
  assert.deepEqual(at, [0, 1]);
  fire(node, "blur");
  assert.equal(control.held, false);
  assert.deepEqual(at, [0, 0]);
  assert.equal(changes(), 2);
  control.key({ type: "keydown", code: "ArrowUp", repeat: false });
  assert.equal(control.held, false);
});

function holdToRun() {
  const node = new FakeElement();
  let changes = 0;
  const button = new HoldToRunButton(node, "KeyG", () => (changes += 1));
  return { node, button, changes: () => changes };
}

test("a hold-to-run button is released by a key-up event anywhere", () => {
  const { button, changes } = holdToRun();
  assert.equal(button.key({ type: "keydown", code: "KeyG", repeat: false }), true);
  assert.ok(button.down);
  keyUp("KeyG");
  assert.equal(button.down, false);
  assert.equal(changes(), 2);
});

test("a hold-to-run button is released by blur and by a lost pointer", () => {
  const { node, button, changes } = holdToRun();
  button.key({ type: "keydown", code: "Enter", repeat: false });
  fire(node, "blur");
  assert.equal(button.down, false);
  fire(node, "pointerdown", FINGER);
  assert.ok(button.down);
  fire(node, "lostpointercapture", FINGER);
  assert.equal(button.down, false);
  assert.equal(changes(), 4);
});
