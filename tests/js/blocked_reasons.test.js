import assert from "node:assert/strict";
import { test } from "node:test";

import { connect, pass } from "./browser.js";

const {
  armBlockedReason,
  disarmBlockedReason,
  driveBlockedReason,
  planBlockedReason,
  resetBlockedReason,
  wheelSpeedBlockedReason,
  acquireBlockedReason,
  showsRecording,
} = await import("../../src/tsd_twin/dashboard/static/blocked_reasons.js");

const LEASE = { holder: "ann", reserved_for: null };
const HELD = {
  arm: armBlockedReason,
  disarm: disarmBlockedReason,
  reset: resetBlockedReason,
  speed: wheelSpeedBlockedReason,
};

const HELD_BY_ANN = { code: "held_by", params: { holder: "ann" } };
const LOOSE = { code: "hardware", params: { text: "the wheels are loose" } };

/** The refusals of a robot that accepts all, with these instead. */
function refusals(changed = {}) {
  return { why: { no_lease: HELD_BY_ANN, ...changed } };
}

for (const [request, check] of Object.entries({ ...HELD, drive: driveBlockedReason })) {
  test(`${request}: the page shows the sentence of the robot, or none`, () => {
    const { link, state } = connect();
    state({ lease: LEASE, refusals: refusals() });
    assert.equal(check(link), null);
    state({ lease: LEASE, refusals: refusals({ [request]: LOOSE }) });
    assert.equal(check(link), "The wheels are loose.");
  });

  test(`${request}: a page that is not in control shows what the robot says of that`, () => {
    const { link, state } = connect();
    const lease = { ...LEASE, holder: "bob" };
    const heldByBob = { code: "held_by", params: { holder: "bob" } };
    state({ lease, refusals: refusals({ no_lease: heldByBob }) }, { has_control: false });
    assert.equal(check(link), "bob has control.");
  });

  test(`${request}: a lost link comes before what the robot said last`, () => {
    const { link, state } = connect();
    state({ lease: LEASE, refusals: refusals({ [request]: LOOSE }) });
    pass(2000);
    assert.equal(check(link), "The robot has gone silent.");
  });

  for (const [name, missing] of [
    ["null", { refusals: null }],
    ["missing", {}],
  ]) {
    test(`${request}: ${name} refusals are unknown and no reason is shown`, () => {
      const { link, state } = connect();
      state({ lease: LEASE, ...missing });
      assert.equal(check(link), null);
      state({ lease: { ...LEASE, holder: "bob" }, ...missing }, { has_control: false });
      assert.equal(check(link), "Take control first.");
    });
  }
}

for (const refused of [refusals(), null]) {
  test(`a control never moves a robot that comes to rest, ${refused ? "with" : "without"} refusals`, () => {
    const { link, state } = connect();
    state({ mode: "stopping", lease: LEASE, refusals: refused });
    assert.equal(driveBlockedReason(link), "The robot is stopping.");
  });
}

test("a path is planned in every mode that is not latched", () => {
  const { link, state } = connect();
  const drive = { code: "arm_first" };
  state({ mode: "disarmed", lease: LEASE, refusals: refusals({ drive }) });
  assert.equal(planBlockedReason(link), null);
  state({
    mode: "stopped",
    lease: LEASE,
    refusals: refusals({ drive: { code: "reset_first", params: { mode: "stopped" } } }),
  });
  assert.equal(planBlockedReason(link), "The robot is stopped: reset first.");
  state({ mode: "stopped", lease: LEASE });
  assert.equal(planBlockedReason(link), "The robot is stopped.");
});

test("control can be taken, asked for and released unless it is reserved for another operator", () => {
  const { link, state } = connect();
  const kept = { code: "reserved_for", params: { operator: "bob" } };
  state(
    { lease: { holder: null, reserved_for: null }, refusals: refusals() },
    { has_control: false },
  );
  assert.equal(acquireBlockedReason(link), null);
  state({
    lease: LEASE,
    refusals: refusals({ lease: { code: "driven_by", params: { holder: "ann" } } }),
  });
  assert.equal(acquireBlockedReason(link), null);
  const reserved = (operator) => ({
    lease: { holder: null, reserved_for: operator },
    refusals: refusals({ lease: kept }),
  });
  state(reserved("bob"), { has_control: false });
  assert.equal(acquireBlockedReason(link), "Control is kept for bob, for a moment.");
  state(reserved("ann"), { has_control: false });
  assert.equal(acquireBlockedReason(link), null);
});

test("a replay cannot be driven, armed or taken, on a live page", () => {
  const { link, state } = connect();
  state({ lease: LEASE, refusals: refusals() }, { source: "recording" });
  const reason = "This is a recording: choose a live robot. STOP stops all of those.";
  for (const check of [
    driveBlockedReason,
    armBlockedReason,
    resetBlockedReason,
    acquireBlockedReason,
  ])
    assert.equal(check(link), reason);
  assert.equal(showsRecording(link), true);
  state({ lease: LEASE, refusals: refusals() });
  assert.equal(showsRecording(link), false);
});
