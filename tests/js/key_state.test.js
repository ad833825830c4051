import assert from "node:assert/strict";
import { test } from "node:test";

import { KeyState } from "../../src/tsd_twin/dashboard/static/key_state.js";

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
