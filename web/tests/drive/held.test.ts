import { beforeEach, describe, expect, test } from "vitest";
import { CENTRED, deflectionOf, onScreen, rotated, twistOf } from "../../src/drive/axes";
import { HeldKeys, HeldPointer } from "../../src/drive/held";
import { SprungControl } from "../../src/drive/sprung";
import type { RobotInfo } from "../../src/generated/wire";
import { fakeBrowser, fire, lift, openPage, place, press } from "../support/page";

beforeEach(fakeBrowser);

const down = (code: string, repeat = false) => ({ type: "keydown", code, repeat });
const up = (code: string) => ({ type: "keyup", code, repeat: false });
const MEANINGS = { KeyW: { x: 1 }, KeyS: { x: -1 }, KeyA: { y: 1 } };
const FINGER = { pointerId: 7, button: 0, clientX: 50, clientY: 25 };

describe("keys", () => {
  test("a key is held from its first key-down event to its key-up event", () => {
    const keys = new HeldKeys();
    const taken = [down("KeyW"), down("KeyW", true), down("KeyW"), up("KeyW"), up("KeyW")];
    expect(taken.map((event) => keys.take(event))).toEqual([true, false, false, true, false]);
    expect(keys.size).toBe(0);
  });

  test("a repeat does not begin a hold", () => {
    const keys = new HeldKeys();
    expect([keys.take(down("KeyW", true)), keys.size]).toEqual([false, 0]);
  });

  test("a key that the page released counts only after its key-up, others at once", () => {
    const keys = new HeldKeys();
    keys.take(down("KeyW"));
    keys.cancel();
    expect(keys.size).toBe(0);
    const taken = [down("KeyW", true), down("KeyW"), up("KeyW"), down("KeyW"), down("KeyA")];
    expect(taken.map((event) => keys.take(event))).toEqual([false, false, false, true, true]);
  });

  test("opposite keys cancel each other, keys of two directions add up", () => {
    const keys = new HeldKeys();
    const sums = [up("KeyX"), down("KeyW"), down("KeyA"), down("KeyS"), up("KeyW")].map((event) => {
      keys.take(event);
      const { x, y } = keys.sum(MEANINGS);
      return [x, y];
    });
    expect(sums).toEqual([
      [0, 0],
      [1, 0],
      [1, 1],
      [0, 1],
      [-1, 1],
    ]);
  });
});

describe("pointers", () => {
  function held() {
    const node = document.body.appendChild(document.createElement("div"));
    const calls: string[] = [];
    const note = (name: string) => () => void calls.push(name);
    const pointer = new HeldPointer(node, {
      came: note("came"),
      moved: note("moved"),
      gone: note("gone"),
    });
    return { node, calls, pointer };
  }

  // Browsers have the first without waiting until they paint.
  test.each(["pointerrawupdate", "pointermove"])(
    "a pointer is captured from pointerdown on, and %s moves it",
    (moves) => {
      const { node, calls, pointer } = held();
      fire(node, "pointerdown", FINGER);
      fire(node, moves, FINGER);
      fire(node, moves, { ...FINGER, pointerId: 8 });
      expect([pointer.down, node.hasPointerCapture(7), calls]).toEqual([
        true,
        true,
        ["came", "moved"],
      ]);
    },
  );

  test.each(["pointerup", "pointercancel", "lostpointercapture"])(
    "%s of the captured pointer ends the hold, once",
    (end) => {
      const { node, calls, pointer } = held();
      fire(node, "pointerdown", FINGER);
      fire(node, end, { pointerId: 8 });
      expect(pointer.down).toBe(true);
      fire(node, end, FINGER);
      fire(node, "lostpointercapture", FINGER);
      expect([pointer.down, calls]).toEqual([false, ["came", "gone"]]);
    },
  );

  test("a second pointer and a second mouse button do not take the control", () => {
    const { node, calls } = held();
    fire(node, "pointerdown", { ...FINGER, button: 2 });
    expect(calls).toEqual([]);
    fire(node, "pointerdown", FINGER);
    fire(node, "pointerdown", { ...FINGER, pointerId: 8 });
    fire(node, "pointermove", { ...FINGER, pointerId: 8 });
    expect(calls).toEqual(["came"]);
  });

  test("what a cancelled pointer still does is ignored until it comes down again", () => {
    const { node, calls, pointer } = held();
    fire(node, "pointerdown", FINGER);
    pointer.cancel();
    expect([pointer.down, node.hasPointerCapture(7)]).toEqual([false, false]);
    fire(node, "pointermove", FINGER);
    fire(node, "pointerup", FINGER);
    expect(calls).toEqual(["came"]);
    fire(node, "pointerdown", FINGER);
    expect(calls).toEqual(["came", "came"]);
  });
});

describe("a control that springs", () => {
  const ARROWS = { ArrowUp: { x: 1 }, ArrowLeft: { y: 1 } };

  function sprung() {
    const page = openPage();
    const node = document.body.appendChild(document.createElement("div"));
    place(node, 100, 100);
    const control = new SprungControl(
      page.drive,
      ({ clientX }, { width }) => ({ ...CENTRED, x: clientX / width }),
      ARROWS,
    );
    const detach = control.attach(node);
    const x = () => control.deflection.value.x;
    return { ...page, node, control, detach, x };
  }

  test("follows the pointer and returns to the centre on release", () => {
    const { node, control, x, take } = sprung();
    fire(node, "pointerdown", FINGER);
    expect([control.held, x()]).toEqual([true, 0.5]);
    fire(node, "pointermove", { ...FINGER, clientX: 100 });
    expect(x()).toBe(1);
    fire(node, "pointerup", FINGER);
    expect([control.held, x()]).toEqual([false, 0]);
    expect(take("release")).toHaveLength(1);
  });

  test("drops its arrow keys when it loses the focus", () => {
    const { node, control, x } = sprung();
    press(node, "ArrowUp");
    press(node, "KeyX");
    expect([control.held, x()]).toEqual([true, 1]);
    fire(node, "blur");
    expect([control.held, x()]).toEqual([false, 0]);
    press(node, "ArrowUp");
    expect(control.held).toBe(false);
  });

  test("keeps its finger when another finger, on another control, takes the focus", () => {
    const { node, control, x } = sprung();
    press(node, "ArrowUp");
    fire(node, "pointerdown", FINGER);
    fire(node, "blur");
    expect([control.held, x()]).toEqual([true, 0.5]);
  });

  test("counts a key-up also with a modifier, and a key-down without one only", () => {
    const { node, control } = sprung();
    press(node, "ArrowUp", { ctrlKey: true });
    expect(control.held).toBe(false);
    press(node, "ArrowUp");
    expect(control.held).toBe(true);
    lift(node, "ArrowUp", { ctrlKey: true });
    expect(control.held).toBe(false);
  });

  test("is at zero with Home, and acts again only after its keys were lifted", () => {
    const { node, control, x } = sprung();
    press(node, "ArrowUp");
    press(node, "Home");
    press(node, "ArrowUp");
    expect([control.held, x()]).toEqual([false, 0]);
    lift(node, "ArrowUp");
    press(node, "ArrowUp");
    expect(x()).toBe(1);
  });

  test("takes no keys that were typed on a control inside", () => {
    const { node, control } = sprung();
    press(node.appendChild(document.createElement("div")), "ArrowUp");
    expect(control.held).toBe(false);
  });

  test("is released with its page, and stays so", () => {
    const { node, drive, control, detach, take } = sprung();
    fire(node, "pointerdown", FINGER);
    detach();
    expect([control.held, drive.held.value]).toEqual([false, false]);
    take();
    fire(node, "pointerdown", FINGER);
    expect(take()).toEqual([]);
  });
});

describe("axes", () => {
  const sphere = { space: "sphere" } as RobotInfo;

  test.each([
    [
      { x: 1, y: 0 },
      { right: 0, down: -1 },
    ],
    [
      { x: -1, y: 0 },
      { right: 0, down: 1 },
    ],
    [
      { x: 0, y: 1 },
      { right: -1, down: 0 },
    ],
    [
      { x: 0, y: -1 },
      { right: 1, down: 0 },
    ],
  ])("on the screen, %o points to %o", (deflection, point) => {
    expect(onScreen(deflection)).toEqual(point);
  });

  test.each([null, sphere])("a twist becomes the deflection that made it", (robot) => {
    const deflection = { x: 0.2, y: -0.3, turn: 0.4 };
    expect(deflectionOf(robot, twistOf(robot, deflection))).toEqual(deflection);
  });

  test("up rolls the top of a sphere away, about Y; left rolls it left, about minus X", () => {
    expect(twistOf(sphere, { x: 1, y: 0, turn: 0 }).map(Math.abs)).toEqual([0, 1, 0]);
    expect(twistOf(sphere, { x: 1, y: 0, turn: 0 })[1]).toBe(1);
    expect(twistOf(sphere, { x: 0, y: 1, turn: 0 })[0]).toBe(-1);
  });

  test("ahead of a robot that has turned left is to the left of the floor's x", () => {
    const { x, y } = rotated({ x: 1, y: 0, turn: 0 }, Math.PI / 2);
    expect([x, y].map((value) => Math.round(value))).toEqual([0, 1]);
  });
});
