import { beforeEach, describe, expect, test, vi } from "vitest";
import { CENTRED } from "../../src/drive/axes";
import type { Ended, Source } from "../../src/drive/drive";
import { fakeBrowser, fire, lift, openPage, press, ROBOT } from "../support/page";

beforeEach(fakeBrowser);

/** A control that the test holds. */
function hand(): Source & { held: boolean; share: typeof CENTRED; cancelled: number } {
  return {
    held: false,
    cancelled: 0,
    share: CENTRED,
    cancel() {
      this.cancelled += 1;
      this.held = false;
      this.share = CENTRED;
    },
  };
}

function driven() {
  const page = openPage();
  const ended: Ended[] = [];
  page.drive.onEnded = (why) => ended.push(why);
  const stick = hand();
  page.drive.add(stick);
  const push = (x: number, y = 0, turn = 0) => {
    Object.assign(stick, { held: true, share: { x, y, turn } });
    page.drive.changed();
  };
  const letGo = () => {
    stick.held = false;
    page.drive.changed();
  };
  return { ...page, stick, ended, push, letGo };
}

test("a held control sends at once, then every 20 ms, and a release when it is let go", () => {
  const { push, letGo, pass, take } = driven();
  push(1);
  expect(take()).toEqual([
    { t: "drive", vx: 2, vy: 0, omega: 0, frame: "base_link", status_seq: 1 },
  ]);
  pass(1000, {});
  expect(take("drive")).toHaveLength(50);
  letGo();
  expect(take()).toEqual([{ t: "release" }]);
  pass(200, {});
  expect(take()).toEqual([]);
});

test("no control drives a robot while the page shows all robots", () => {
  const { push, pass, take, session, ended } = driven();
  push(1);
  take();
  session.layout.screen.value = "fleet";
  expect(take("release")).toHaveLength(1);
  push(1);
  pass(200, {});
  press(null, "KeyW");
  expect(take("drive")).toEqual([]);
  expect(ended.at(-1)).toEqual({ refusal: { by: "page", code: "fleet_shown" }, atStart: true });
  session.layout.screen.value = "robot";
  pass(200, {});
  expect(take("drive")).toEqual([]);
  push(1);
  expect(take("drive")).toHaveLength(1);
});

test("a control that moves all the time sends at most every 10 ms", () => {
  const { push, pass, take } = driven();
  push(1);
  take();
  for (let i = 0; i < 200; i += 1) {
    pass(1);
    push(i / 200);
  }
  const { length } = take("drive");
  expect(length).toBeGreaterThan(15);
  expect(length).toBeLessThanOrEqual(20);
});

test("full deflection is the chosen speed limit, and the diagonal is no faster", () => {
  const { drive, push, take } = driven();
  drive.level.value = 0.2;
  push(1, 1, 1);
  const [command] = take("drive") as unknown as { vx: number; vy: number; omega: number }[];
  expect(Math.hypot(command!.vx, command!.vy)).toBeCloseTo(0.4);
  expect(command!.omega).toBeCloseTo(0.8);
});

test("a held deflection follows the limits of the robot and of the operator", () => {
  const { drive, push, pass, state, take } = driven();
  push(1);
  state({ limits: { speed_mps: 1, turn_rate_rad_per_s: 0, applied: 1, why: [] } });
  pass(20);
  expect(take("drive").at(-1)).toMatchObject({ vx: 1 });
  expect(drive.asked.value.x).toBe(1);
  drive.level.value = 0.5;
  pass(20);
  expect(take("drive").at(-1)).toMatchObject({ vx: 0.5 });
});

test("several controls together stay within the limits of the robot", () => {
  const { drive, push, pass, take } = driven();
  const other = { ...hand(), held: true, share: { x: 1, y: 1, turn: 1 } };
  drive.add(other);
  push(1, 0, 1);
  pass(20);
  const command = take("drive").at(-1) as unknown as { vx: number; vy: number; omega: number };
  expect(Math.hypot(command.vx, command.vy)).toBeCloseTo(2);
  expect(command.omega).toBeCloseTo(4);
});

test("a robot that cannot move sideways is not asked to", () => {
  const { push, say, state, take } = driven();
  say({ ...ROBOT, sideways: false });
  state();
  push(0.5, 0.5);
  expect(take("drive")[0]).toMatchObject({ vy: 0 });
});

test.each([
  ["blur of the window", () => fire(null, "blur")],
  ["leaving the page", () => fire(null, "pagehide")],
  ["hiding the tab", () => fire(document, "visibilitychange")],
  ["the key that hides key-ups", () => press(null, "MetaLeft", { key: "Meta" })],
])("%s releases all controls", (_, leave) => {
  const { drive, push, stick, pass, take } = driven();
  push(1);
  take();
  leave();
  expect([drive.held.value, stick.held]).toEqual([false, false]);
  expect(take()).toEqual([{ t: "release" }]);
  pass(200, {});
  expect(take()).toEqual([]);
});

test("a release goes out when the socket is congested, a command does not", () => {
  const { push, letGo, socket, pass, take } = driven();
  push(1);
  take();
  socket.bufferedAmount = 5000;
  pass(100);
  expect(take()).toEqual([]);
  letGo();
  expect(take()).toEqual([{ t: "release" }]);
});

test.each([
  ["the robot is stopped, as the deck says,", { mode: "stopped" }, {}, false],
  ["the robot comes to rest", { mode: "stopping" }, {}, true],
  ["control is lost", {}, { has_control: false }, true],
])("when %s controls are released until they are used again", (_, status, fields, told) => {
  const { drive, push, stick, state, pass, take, ended } = driven();
  push(1);
  take();
  state(status, fields);
  expect(drive.held.value).toBe(false);
  expect(stick.cancelled).toBeGreaterThan(0);
  expect(take()).toEqual([{ t: "release" }]);
  expect(ended.length > 0).toBe(told);
  state();
  pass(100);
  expect(take()).toEqual([]);
});

test("no command goes out when no state has come for 300 ms", () => {
  const { drive, push, pass, take } = driven();
  push(1);
  pass(270);
  take();
  pass(60);
  expect(drive.held.value).toBe(false);
  expect(take().at(-1)).toEqual({ t: "release" });
});

test("a control cannot begin while the robot is disarmed", () => {
  const { drive, push, stick, state, ended, take } = driven();
  state({ mode: "disarmed", refusals: { why: { drive: { code: "arm_first" } } } });
  push(1);
  expect([drive.held.value, stick.held, take()]).toEqual([false, false, []]);
  expect(ended).toMatchObject([{ refusal: { by: "robot", reason: { code: "arm_first" } } }]);
});

test("a release by the server is answered, also when nothing was held", () => {
  const { drive, push, say, stick, take } = driven();
  push(1);
  take();
  say({ t: "released", why: { code: "page_stalled" } });
  expect(drive.held.value || stick.held).toBe(false);
  expect(take()).toEqual([{ t: "release" }]);
  say({ t: "released", why: { code: "page_stalled" } });
  expect(take()).toEqual([{ t: "release" }]);
});

test("a lost connection releases the controls", () => {
  const { drive, push, socket, ended } = driven();
  push(1);
  socket.readyState = 3;
  socket.onclose();
  expect(drive.held.value).toBe(false);
  expect(ended).toEqual([{ lost: true }]);
});

test("a control in the hand ends a value that is kept", () => {
  const { drive, push, pass, take } = driven();
  const kept = { ...hand(), alone: true, held: true, share: { x: 0.15, y: 0, turn: 0 } };
  drive.add(kept);
  drive.changed();
  expect(drive.alone.value).toBe(true);
  expect(take("drive")[0]).toMatchObject({ vx: 0.3 });
  push(1);
  expect([kept.held, drive.alone.value]).toEqual([false, false]);
  pass(20);
  expect(take("drive").at(-1)).toMatchObject({ vx: 2 });
});

test("what is only looked at moves the picture and nothing else", () => {
  const { drive, state, take } = driven();
  state({ mode: "disarmed" }, { has_control: false });
  const looking = { ...hand(), looksOnly: true, held: true, share: { x: 0.15, y: 0, turn: 0 } };
  drive.add(looking);
  drive.changed();
  expect(take()).toEqual([{ t: "preview", twist: [0.3, 0, 0] }]);
  looking.held = false;
  drive.changed();
  expect(take()).toEqual([{ t: "preview", twist: null }]);
});

test("a change of the axes releases what is held", () => {
  const { drive, push, stick, pass, take } = driven();
  push(1);
  take();
  drive.setFrame("odom");
  expect(stick.held).toBe(false);
  pass(20);
  push(1);
  expect(take("drive")).toMatchObject([{ frame: "odom", vx: 2 }]);
});

describe("keys", () => {
  test("W drives while it is held; its key-up counts also with Ctrl, in a text field", () => {
    const { session, take } = driven();
    const event = press(null, "KeyW");
    expect([event.defaultPrevented, session.keyboard.held]).toEqual([true, true]);
    expect(take("drive")).toMatchObject([{ vx: 2 }]);
    const field = document.body.appendChild(document.createElement("input"));
    lift(field, "KeyW", { ctrlKey: true });
    expect(session.keyboard.held).toBe(false);
    expect(take("release")).toEqual([{ t: "release" }]);
  });

  test("a key that is held across a blur drives only after it was lifted", () => {
    const { session, pass, take } = driven();
    press(null, "KeyW");
    fire(null, "blur");
    take();
    press(null, "KeyW");
    pass(50);
    expect([session.keyboard.held, take()]).toEqual([false, []]);
    lift(null, "KeyW");
    press(null, "KeyW");
    expect(take("drive")).toHaveLength(1);
    lift(null, "KeyW");
  });

  test("the space bar stops, once for each press, but types in a text field", () => {
    const { take } = driven();
    const type = (inputMode: string, type = "text") => {
      const field = document.body.appendChild(document.createElement("input"));
      Object.assign(field, { type, inputMode });
      press(field, "Space");
      return take("stop").length;
    };
    press(null, "Space");
    press(null, "Space", { repeat: true });
    expect(take("stop")).toHaveLength(1);
    expect([type(""), type("decimal"), type("", "checkbox")]).toEqual([0, 1, 1]);
  });

  test("Enter that is held down presses a button once, not Arm and Disarm in turn", () => {
    driven();
    const button = document.body.appendChild(document.createElement("button"));
    expect(press(button, "Enter").defaultPrevented).toBe(false);
    expect(press(button, "Enter", { repeat: true }).defaultPrevented).toBe(true);
  });
});

describe("gamepad", () => {
  function plugged(axes = [0, 0, 0]) {
    const page = driven();
    const pad = { index: 0, id: "pad", connected: true, axes, buttons: [{}, { pressed: false }] };
    const pads: (typeof pad | null)[] = [pad];
    vi.stubGlobal("navigator", { getGamepads: () => pads, languages: ["en"] });
    fire(null, "gamepadconnected", { gamepad: pad });
    const unplug = () => {
      pads[0] = null;
      fire(null, "gamepaddisconnected", { gamepad: pad });
    };
    return { ...page, pad, unplug, source: page.session.gamepad };
  }

  test("one that is found with its stick pushed drives only after it was at rest", () => {
    const { source, pad, unplug, pass, take } = plugged([0, -1, 0]);
    pass(100, {});
    expect([source.held, take()]).toEqual([false, []]);
    pad.axes = [0, 0.05, 0];
    pass(40, {});
    pad.axes = [0, -1, 0];
    pass(50, {});
    expect(source.held).toBe(true);
    expect(take("drive").at(-1)).toMatchObject({ vx: 2 });
    unplug();
    expect(source.held).toBe(false);
    expect(take("release")).toEqual([{ t: "release" }]);
  });

  test("one that was released by the page must come to rest first", () => {
    const { source, drive, pad, unplug, pass, take } = plugged();
    pass(50, {});
    pad.axes = [0, 0, 1];
    pass(50, {});
    expect((take("drive").at(-1) as { omega?: number }).omega).toBeLessThan(0);
    drive.release();
    pass(100, {});
    expect([source.held, take("drive")]).toEqual([false, []]);
    pad.axes = [0, 0, 0];
    pass(50, {});
    pad.axes = [0, 0, 1];
    pass(50, {});
    expect(source.held).toBe(true);
    unplug();
  });

  test("button B stops, once for each press", () => {
    const { pad, unplug, pass, take } = plugged();
    (pad.buttons[1] as { pressed: boolean }).pressed = true;
    pass(100, { mode: "stopped" });
    expect(take("stop")).toHaveLength(1);
    unplug();
  });
});

test("a limit of zero allows no turning at all", () => {
  const { push, pass, state, take } = driven();
  push(1, 0, 1);
  state({ limits: { speed_mps: 1, turn_rate_rad_per_s: 0, applied: 1, why: [] } });
  pass(20);
  expect(take("drive").at(-1)).toMatchObject({ vx: 1, omega: 0 });
});

test("Enter ticks a box, once for each press, and the space bar stops there without ticking", () => {
  const { take } = driven();
  const box = document.body.appendChild(document.createElement("input"));
  box.type = "checkbox";
  expect(press(box, "Enter").defaultPrevented).toBe(true);
  press(box, "Enter", { repeat: true });
  lift(box, "Enter");
  expect([box.checked, take("stop")]).toEqual([true, []]);
  const space = [press(box, "Space"), press(box, "Space", { repeat: true }), lift(box, "Space")];
  expect(space.map(({ defaultPrevented }) => defaultPrevented)).toEqual([true, true, true]);
  expect([box.checked, take("stop").length]).toEqual([true, 1]);
});

test("the space bar stops on a button too, and does not press it", () => {
  const { take } = driven();
  const button = document.body.appendChild(document.createElement("button"));
  const space = [press(button, "Space"), lift(button, "Space")];
  expect(space.map(({ defaultPrevented }) => defaultPrevented)).toEqual([true, true]);
  expect(take("stop")).toHaveLength(1);
});

test("another key acts once for each press, but not with a modifier or in a text field", () => {
  const { session } = driven();
  const pressed = vi.fn();
  const end = session.keyboard.bind({ KeyZ: pressed });
  expect(press(null, "KeyZ").defaultPrevented).toBe(true);
  press(null, "KeyZ", { repeat: true });
  press(null, "KeyZ", { ctrlKey: true });
  press(document.body.appendChild(document.createElement("input")), "KeyZ");
  lift(null, "KeyZ");
  expect(pressed).toHaveBeenCalledTimes(1);
  end();
  expect(press(null, "KeyZ").defaultPrevented).toBe(false);
});
