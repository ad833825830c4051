import assert from "node:assert/strict";
import { test } from "node:test";

import {
  button,
  connect,
  field,
  fire,
  gamepad,
  keyDown,
  keyUp,
  pass,
  plugIn,
  unplug,
} from "./browser.js";

const { Drive } = await import("../../src/tsd_twin/dashboard/static/drive.js");
const { Gamepad } = await import("../../src/tsd_twin/dashboard/static/gamepad.js");
const { Keyboard } = await import("../../src/tsd_twin/dashboard/static/keyboard.js");

/** A source of motion that the test holds. */
function hand() {
  return {
    held: false,
    cancelled: 0,
    unit: { x: 0, y: 0, turn: 0 },
    cancel() {
      this.cancelled += 1;
      this.held = false;
      this.unit = { x: 0, y: 0, turn: 0 };
    },
  };
}

function driven() {
  const server = connect();
  const drive = new Drive(server.link);
  const said = [];
  drive.onMessage = ({ text }) => said.push(text);
  const stick = hand();
  drive.add(stick);
  const push = (x, y = 0, turn = 0) => {
    Object.assign(stick, { held: true, unit: { x, y, turn } });
    drive.changed();
  };
  const letGo = () => {
    stick.held = false;
    drive.changed();
  };
  pass(20);
  return { ...server, drive, stick, said, push, letGo };
}

test("a held control sends at once, then every 20 ms, and a release when it is let go", () => {
  const { push, letGo, state, take } = driven();
  push(1);
  assert.deepEqual(take(), [
    { t: "drive", vx: 1, vy: 0, omega: 0, frame: "base_link", status_seq: 1 },
  ]);
  for (let i = 0; i < 10; i += 1) {
    pass(100);
    state();
  }
  assert.equal(take("drive").length, 50);
  letGo();
  assert.deepEqual(take(), [{ t: "release" }]);
  pass(200);
  assert.deepEqual(take(), []);
});

test("a control that moves all the time sends at most every 10 ms", () => {
  const { push, state, take } = driven();
  push(1);
  take();
  for (let i = 0; i < 200; i += 1) {
    pass(1);
    push(i / 200);
    if (i % 50 === 0) state();
  }
  const { length } = take("drive");
  assert.ok(length > 15 && length <= 20, `${length} commands in 200 ms`);
});

test("the speed level scales the limits in force, and the diagonal is no faster", () => {
  const { drive, push, take, state } = driven();
  drive.level = 20;
  push(1, 1, 1);
  const [{ vx, vy, omega }] = take("drive");
  assert.ok(Math.abs(Math.hypot(vx, vy) - 0.4) < 1e-9);
  assert.ok(Math.abs(omega - 0.8) < 1e-9);
  state({ limits: { speed_mps: 1, turn_rate_rad_per_s: 0 } });
  pass(20);
  const slower = take("drive").at(-1);
  assert.ok(Math.abs(Math.hypot(slower.vx, slower.vy) - 0.2) < 1e-9);
  assert.equal(slower.omega, 0);
});

for (const [name, leave] of [
  ["blur of the window", () => fire(null, "blur")],
  ["leaving the page", () => fire(null, "pagehide")],
  ["hiding the tab", () => fire(document, "visibilitychange")],
]) {
  test(`${name} releases all controls`, () => {
    const { drive, push, stick, take } = driven();
    push(1);
    take();
    leave();
    assert.equal(drive.held, false);
    assert.equal(stick.held, false);
    assert.deepEqual(take(), [{ t: "release" }]);
    pass(200);
    assert.deepEqual(take(), []);
  });
}

test("a release goes out when the socket is congested, a command does not", () => {
  const { push, letGo, socket, take } = driven();
  push(1);
  take();
  socket.bufferedAmount = 5000;
  pass(100);
  assert.deepEqual(take(), []);
  letGo();
  assert.deepEqual(take(), [{ t: "release" }]);
});

test("a stop goes out when the socket is congested, before the release", () => {
  const { drive, push, socket, take } = driven();
  push(1);
  take();
  socket.bufferedAmount = 5000;
  drive.stop();
  assert.deepEqual(take(), [{ t: "stop" }, { t: "release" }]);
});

test("a stop is repeated until the robot is stopped, with an alarm from 600 ms to then", () => {
  const { drive, state, take } = driven();
  drive.stop();
  assert.deepEqual(take("stop"), [{ t: "stop" }]);
  pass(500);
  assert.equal(drive.stopUnconfirmed, false);
  pass(500);
  assert.ok(take("stop").length >= 3);
  assert.equal(drive.stopUnconfirmed, true);
  drive.stop();
  assert.equal(drive.stopUnconfirmed, true);
  state({ mode: "stopped" });
  assert.equal(drive.stopUnconfirmed, false);
  take();
  pass(1000);
  assert.deepEqual(take("stop"), []);
});

for (const source of ["recording", "several"]) {
  test(`no state of source "${source}" confirms a stop, only the reply of the robots`, () => {
    const { drive, say, state } = driven();
    state({}, { source });
    drive.stop();
    for (let i = 0; i < 30; i += 1) {
      pass(30);
      state({ mode: i % 10 < 5 ? "stopped" : "fault" }, { source });
    }
    assert.equal(drive.stopUnconfirmed, true);
    say({ t: "reply", to: "stop", ok: false, why: { code: "no_answer" } });
    assert.equal(drive.stopUnconfirmed, true);
    say({ t: "reply", to: "stop", ok: true, why: null });
    assert.equal(drive.stopUnconfirmed, false);
  });
}

test("the alarm of a stop outlasts its repetitions, and another robot does not end it", () => {
  const { drive, say, state, take } = driven();
  drive.stop();
  pass(6000);
  take();
  pass(1000);
  assert.deepEqual(take("stop"), []);
  assert.equal(drive.stopUnconfirmed, true);
  say({ t: "robot", id: "bob", panel: "gimbals", twist_scale_m: 1 });
  state({ mode: "stopped" });
  assert.equal(drive.stopUnconfirmed, true);
  drive.acknowledgeStop();
  assert.equal(drive.stopUnconfirmed, false);
});

test("a state on its way confirms no stop of a robot that was stopped before", () => {
  const { drive, state } = driven();
  state({ mode: "stopped" });
  drive.stop();
  state({ mode: "stopped" });
  pass(700);
  assert.equal(drive.stopUnconfirmed, true);
  for (let i = 0; i < 20; i += 1) state({ mode: "stopped" });
  assert.equal(drive.stopUnconfirmed, false);
});

test("a confirmed stop is not repeated", () => {
  const { drive, say, take } = driven();
  drive.stop();
  say({ t: "reply", to: "stop", ok: true, why: null });
  take();
  pass(1000);
  assert.deepEqual(take("stop"), []);
});

const TAKE_FIRST = "Take control first.";
for (const [name, status, fields, notices] of [
  ["the robot is stopped, as its card says,", { mode: "stopped" }, {}, []],
  ["the robot comes to rest, as an event says,", { mode: "stopping" }, {}, []],
  ["control is lost", { lease: { holder: "bob" } }, { has_control: false }, [TAKE_FIRST]],
]) {
  test(`when ${name}, controls are released and do nothing until they are used anew`, () => {
    const { drive, push, stick, state, take, said } = driven();
    push(1);
    take();
    state(status, fields);
    assert.equal(drive.held, false);
    assert.equal(stick.cancelled > 0, true);
    assert.deepEqual(take(), [{ t: "release" }]);
    assert.deepEqual(said, notices);
    state();
    pass(100);
    assert.deepEqual(take(), []);
  });
}

test("no command goes out when no state has come for 300 ms", () => {
  const { drive, push, take } = driven();
  push(1);
  pass(280);
  take();
  pass(60);
  assert.equal(drive.held, false);
  assert.deepEqual(take().at(-1), { t: "release" });
});

test("a control cannot begin while the robot is disarmed", () => {
  const { drive, push, stick, state, said, take } = driven();
  state({ mode: "disarmed", refusals: { why: { drive: { code: "arm_first" } } } });
  push(1);
  assert.equal(drive.held, false);
  assert.equal(stick.held, false);
  assert.deepEqual(take(), []);
  assert.deepEqual(said, ["The robot is disarmed: arm it first."]);
});

test("a release by the server is answered, also when nothing was held", () => {
  const { drive, push, say, stick, take } = driven();
  push(1);
  take();
  say({ t: "released", why: { code: "too_late" } });
  assert.equal(drive.held || stick.held, false);
  assert.deepEqual(take(), [{ t: "release" }]);
  say({ t: "released", why: { code: "too_late" } });
  assert.deepEqual(take(), [{ t: "release" }]);
});

for (const [why, notices] of [
  [
    { code: "page_stalled", params: { s: 0.2 } },
    ["Your page stalled for 0.2 s, so the robot stopped. Let go, then push again."],
  ],
  [
    { code: "page_silent", params: { s: 1 } },
    ["Your page was silent for 1 s, so it lost control: take it again."],
  ],
  [{ code: "stop_pressed" }, []],
  [{ code: "control_is_lost", cause: { code: "lease_ended" } }, []],
  [{ code: "reset_first", params: { mode: "stopped" } }, []],
  [{ code: "mode_only", params: { mode: "stopping" } }, []],
]) {
  test(`a release by the server, ${why.code}, is told once`, () => {
    const { push, say, said } = driven();
    push(1);
    say({ t: "released", why });
    assert.deepEqual(said, notices);
  });
}

test("a lost connection releases the controls", () => {
  const { drive, push, socket, said } = driven();
  push(1);
  socket.readyState = 3;
  socket.onclose();
  assert.equal(drive.held, false);
  assert.deepEqual(said, ["The connection is lost."]);
});

test("a control in the hand ends what is latched in the panel", () => {
  const { drive, push, take } = driven();
  const panel = { ...hand(), twist: { vx: 0.3, vy: 0, omega: 0 }, unit: undefined, held: true };
  drive.add(panel);
  drive.changed();
  assert.equal(take("drive")[0].vx, 0.3);
  pass(20);
  take();
  push(1);
  assert.equal(panel.held, false);
  pass(20);
  assert.equal(take("drive").at(-1).vx, 1);
});

function withKeyboard() {
  const all = driven();
  const stops = [];
  const stop = (isOnBox) => stops.push(isOnBox);
  const keys = new Keyboard(all.drive, { focused: () => false, stop });
  all.drive.add(keys);
  return { ...all, keys, stops };
}

test("W drives while it is held; its key-up event counts also with Ctrl held in a text field", () => {
  const { take, keys } = withKeyboard();
  const event = keyDown("KeyW");
  assert.ok(event.defaultPrevented && keys.held);
  assert.equal(take("drive")[0].vx, 1);
  fire(null, "keyup", { code: "KeyW", ctrlKey: true, composedPath: () => [field()] });
  assert.equal(keys.held, false);
  assert.deepEqual(take("release"), [{ t: "release" }]);
});

test("a key that is held across a blur drives only after it was lifted", () => {
  const { take, keys } = withKeyboard();
  keyDown("KeyW");
  fire(null, "blur");
  take();
  keyDown("KeyW");
  pass(50);
  assert.equal(keys.held, false);
  assert.deepEqual(take(), []);
  keyUp("KeyW");
  keyDown("KeyW");
  assert.equal(take("drive").length, 1);
  keyUp("KeyW");
});

test("the space bar stops, once for each press, and not from a text field", () => {
  const { stops } = withKeyboard();
  keyDown("Space");
  keyDown("Space", { repeat: true });
  assert.equal(stops.length, 1);
  keyDown("Space", { composedPath: () => [field()] });
  assert.equal(stops.length, 1);
  keyDown("Space", { composedPath: () => [field({ inputMode: "decimal" })] });
  assert.equal(stops.length, 2);
});

test("Enter ticks a box, once for each press, and the space bar stops there, too", () => {
  const { stops } = withKeyboard();
  const box = field({ type: "checkbox" });
  const onBox = { composedPath: () => [box] };
  assert.ok(keyDown("Enter", onBox).defaultPrevented);
  keyDown("Enter", { ...onBox, repeat: true });
  fire(null, "keyup", { code: "Enter", ...onBox });
  assert.equal(box.clicks, 1);
  assert.deepEqual(stops, []);
  keyDown("Space", onBox);
  assert.equal(box.clicks, 1);
  assert.deepEqual(stops, [true]);
});

test("Enter that is held down presses a button once, not Arm and Disarm in turn", () => {
  withKeyboard();
  const onButton = { composedPath: () => [button()] };
  assert.equal(keyDown("Enter", onButton).defaultPrevented, false);
  assert.ok(keyDown("Enter", { ...onButton, repeat: true }).defaultPrevented);
});

function withGamepad() {
  const all = driven();
  const stops = [];
  const source = new Gamepad(all.drive, () => stops.push(1));
  all.drive.add(source);
  return { ...all, source, stops };
}

test("a gamepad that is found with its stick pushed drives only after it was at rest", () => {
  const { source, take } = withGamepad();
  const pad = gamepad([0, -1, 0]);
  plugIn(pad);
  pass(100);
  assert.equal(source.held, false);
  assert.deepEqual(take(), []);
  pad.axes = [0, 0.05, 0];
  pass(40);
  pad.axes = [0, -1, 0];
  pass(40);
  assert.ok(source.held);
  assert.equal(take("drive").at(-1).vx, 1);
  unplug(pad);
  assert.equal(source.held, false);
  assert.deepEqual(take("release"), [{ t: "release" }]);
});

test("a gamepad that was released by the page must come to rest first", () => {
  const { source, drive, take } = withGamepad();
  const pad = gamepad();
  plugIn(pad);
  pass(40);
  pad.axes = [0, 0, 1];
  pass(40);
  assert.ok(take("drive").at(-1).omega < 0);
  drive.release();
  pass(100);
  assert.equal(source.held, false);
  assert.deepEqual(take("drive"), []);
  pad.axes = [0, 0, 0];
  pass(40);
  pad.axes = [0, 0, 1];
  pass(40);
  assert.ok(source.held);
  unplug(pad);
});

test("button B of a gamepad stops, once for each press", () => {
  const { stops } = withGamepad();
  const pad = gamepad();
  plugIn(pad);
  pad.buttons[1].pressed = true;
  pass(100);
  assert.equal(stops.length, 1);
  unplug(pad);
});
