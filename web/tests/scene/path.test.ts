import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import type { Wish } from "../../src/drive/path";
import { MIN_STEP_PX, Picker, type Pixel, thinned } from "../../src/scene/pick";
import { codeOf } from "../../src/store/permission";
import { openSession, press, ROBOT, route } from "./support";

const WISH: Wish = { kind: "to", on: "floor", points: [[1, 2]] };

beforeEach(() => {
  vi.useFakeTimers();
});

afterEach(() => {
  press("KeyG", "keyup");
  vi.useRealTimers();
});

function open() {
  const page = openSession();
  const refused: string[] = [];
  page.session.path.onRefused = (refusal) => refused.push(codeOf(refusal));
  return { ...page, path: page.session.path, refused };
}

describe("planning", () => {
  test("A plan is asked for with the speed level, and moves nothing.", () => {
    const { session, path, take } = open();
    session.drive.level.value = 0.8;
    path.plan(WISH);
    expect(take("plan", "drive", "follow_plan")).toEqual([{ t: "plan", ...WISH, level: 80 }]);
  });

  test("Without control nothing is planned, the reason is given, and an old path is dropped.", () => {
    const { path, state, take, refused } = open();
    state({ has_control: false, route: route("planned") });
    path.plan(WISH);
    expect(take("plan", "clear_plan")).toEqual([{ t: "clear_plan" }]);
    expect(refused).toEqual(["take_control_first"]);
  });

  test("A refusal by the dashboard is passed on.", () => {
    const { path, say, refused } = open();
    path.plan(WISH);
    say({ t: "reply", to: "plan", ok: false, why: { code: "path_out_of_date" } });
    expect(refused).toEqual(["path_out_of_date"]);
    expect(path.wish.value).toBeNull();
  });

  test("A change of the speed level is sent while there is a path.", () => {
    const { session, state, take } = open();
    session.drive.level.value = 0.3;
    expect(take("speed_level")).toEqual([]);
    state({ route: route("planned") });
    session.drive.level.value = 0.6;
    expect(take("speed_level")).toEqual([{ t: "speed_level", level: 60 }]);
  });
});

describe("following", () => {
  test("A held path is sent repeatedly until it is released.", () => {
    const { path, state, take } = open();
    state({ route: route("planned", 7) });
    take();
    expect(path.hold()).toBe(true);
    vi.advanceTimersByTime(200);
    const sent = take("follow_plan", "drive");
    expect(sent.length).toBeGreaterThan(5);
    expect(sent.every(({ t, route: number }) => t === "follow_plan" && number === 7)).toBe(true);
    path.letGo();
    expect(take("release")).toHaveLength(1);
    vi.advanceTimersByTime(200);
    expect(take("follow_plan")).toEqual([]);
  });

  test("Without a path, or while the robot moves, holding does nothing and says why.", () => {
    const { path, state, take, refused } = open();
    expect(path.hold()).toBe(false);
    state({ route: route("planned") }, "driving");
    expect(path.hold()).toBe(false);
    expect(refused).toEqual(["no_path", "still_moves"]);
    expect(take("follow_plan")).toEqual([]);
  });

  test("Key G holds the path until it comes up, and only if a path is offered.", () => {
    const { path, state, take, refused } = open();
    press("KeyG");
    press("KeyG", "keyup");
    expect(refused).toEqual([]); // Nobody has asked for a path.
    state({ route: route("planned") });
    press("KeyG");
    expect(path.going.value).toBe(true);
    expect(take("follow_plan")).toHaveLength(1);
    press("KeyG", "keyup");
    expect(path.going.value).toBe(false);
    expect(take("release")).toHaveLength(1);
  });

  test("The key-up of G counts also with Ctrl, in a text field.", () => {
    const { path, state, take } = open();
    state({ route: route("planned") });
    press("KeyG");
    const field = document.body.appendChild(document.createElement("input"));
    const lift = { code: "KeyG", ctrlKey: true, bubbles: true };
    field.dispatchEvent(new KeyboardEvent("keyup", lift));
    field.remove();
    expect(path.going.value).toBe(false);
    expect(take("release")).toHaveLength(1);
  });

  test("A key that is still down after a release must come up before it holds again.", () => {
    const { session, path, state } = open();
    state({ route: route("planned") });
    press("KeyG");
    session.drive.release();
    press("KeyG"); // Some systems repeat it as a new press when the focus returns.
    expect(path.going.value).toBe(false);
    press("KeyG", "keyup");
    press("KeyG");
    expect(path.going.value).toBe(true);
  });

  test("Any hand control ends it, and drives.", () => {
    const { path, state, take } = open();
    state({ route: route("planned") });
    path.hold();
    take();
    vi.advanceTimersByTime(50);
    press("KeyW");
    expect(path.going.value).toBe(false);
    vi.advanceTimersByTime(100);
    press("KeyW", "keyup");
    expect(take("drive").length).toBeGreaterThan(0);
  });

  test("Arrival, another path and a lost path end it.", () => {
    for (const next of [route("arrived"), route("going", 2), null]) {
      const { path, state } = open();
      state({ route: route("planned") });
      path.hold();
      state({ route: route("going") }, "driving");
      expect(path.going.value).toBe(true);
      state({ route: next }, "driving");
      expect(path.going.value).toBe(false);
    }
  });

  test("A key typed in the frame never holds a path or drives.", () => {
    const { session, path, state } = open();
    state({ route: route("planned") });
    const key = { type: "keydown", key: "", repeat: false, modified: false } as const;
    session.keyboard.takeForwarded({ ...key, code: "KeyG" });
    session.keyboard.takeForwarded({ ...key, code: "KeyW" });
    expect([path.going.value, session.drive.held.value]).toEqual([false, false]);
  });
});

describe("modes", () => {
  test("A finished path, a stop and the loss of control return to the stick.", () => {
    const ends = [
      [{ route: route("arrived") }, "ready"],
      [{ route: route("ended") }, "ready"],
      [{}, "stopped"],
      [{ has_control: false }, "ready"],
    ] as const;
    for (const [fields, mode] of ends) {
      const { path, state } = open();
      path.choose("draw");
      state();
      expect(path.mode.value).toBe("draw");
      state(fields, mode);
      expect(path.mode.value).toBe("stick");
    }
  });

  test("An old path does not end the next choice.", () => {
    const { path, state } = open();
    state({ route: route("arrived") });
    path.choose("to");
    state({ route: route("arrived") });
    expect(path.mode.value).toBe("to");
  });

  test("Escape discards the path and returns to the stick.", () => {
    const { path, take } = open();
    path.choose("to");
    press("Escape");
    expect(path.mode.value).toBe("stick");
    expect(take("clear_plan")).toHaveLength(1);
    press("Escape");
    expect(take("clear_plan")).toEqual([]);
  });

  test("A sphere has no paths.", () => {
    const { session, state } = openSession({ ...ROBOT, space: "sphere" });
    session.path.choose("to");
    state();
    expect(session.path.mode.value).toBe("stick");
  });
});

describe("picking", () => {
  function pick(mode: "to" | "draw") {
    const page = open();
    page.path.choose(mode);
    const picker = new Picker(page.path, {
      on: "floor",
      toPlace: ([x, y]) => [x / 100, y / 100],
      toPixel: ([x, y]) => [x * 100, y * 100],
    });
    const draw = (...pixels: Pixel[]) => {
      picker.begin(pixels[0]!);
      pixels.slice(1).forEach((pixel) => picker.move(pixel));
      picker.finish();
      return page.take("plan").map(({ kind, points }) => ({ kind, points }));
    };
    return { ...page, picker, draw };
  }

  test("A click is a goal, and a hand that trembles sets no heading.", () => {
    const { draw } = pick("to");
    const near: Pixel = [100 + MIN_STEP_PX - 2, 200];
    expect(draw([100, 200], near)).toEqual([{ kind: "to", points: [[1, 2]] }]);
  });

  test("A drag sets the heading by its end.", () => {
    const { draw } = pick("to");
    const points = [
      [1, 2],
      [2, 3],
    ];
    expect(draw([100, 200], [150, 220], [200, 300])).toEqual([{ kind: "to", points }]);
  });

  test("The handle of a goal turns it and leaves it at its place.", () => {
    const { draw, picker, state } = pick("to");
    draw([100, 200]);
    state({ route: route("planned") });
    const { at, handle, turns } = picker.goal()!;
    expect([at, turns]).toEqual([[100, 200], false]);
    const [plan] = draw([handle[0] + 3, handle[1]], [160, 200]);
    expect(plan!.points).toEqual([
      [1, 2],
      [1.6, 2],
    ]);
    expect(picker.goal()).toMatchObject({ at: [100, 200], handle: [160, 200], turns: true });
  });

  test("A drawn line has all its points, and shows until it is planned.", () => {
    const { draw, picker, state } = pick("draw");
    const line: Pixel[] = [
      [0, 0],
      [50, 0],
      [50, 50],
    ];
    const points = line.map(([x, y]) => [x / 100, y / 100]);
    expect(draw(...line)).toEqual([{ kind: "draw", points }]);
    expect(picker.line()).toEqual(line);
    state({ route: route("planned") });
    expect(picker.line()).toEqual([]);
  });

  test("A held path is not changed by a click.", () => {
    const { draw, path, state } = pick("to");
    state({ route: route("planned") });
    path.hold();
    expect(draw([10, 10])).toEqual([]);
  });

  test("A long line is thinned to what a message allows, with its ends.", () => {
    const long = Array.from({ length: 1001 }, (_, i): Pixel => [i, 0]);
    const few = thinned(long);
    expect(few.length).toBeLessThanOrEqual(200);
    expect([few[0], few.at(-1)]).toEqual([long[0], long[1000]]);
  });
});
