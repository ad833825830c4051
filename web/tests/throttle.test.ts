import { beforeEach, expect, test, vi } from "vitest";
import { RenderThrottle } from "../frame/throttle.ts";

let wanted: ((timeMs: number) => void)[];
let nowMs: number;
let isDrawn: boolean;
const context = {
  SYNC_GPU_COMMANDS_COMPLETE: 1,
  SYNC_STATUS: 2,
  SIGNALED: 3,
  fenceSync: () => ({}),
  getSyncParameter: () => (isDrawn ? 3 : 4),
  deleteSync: () => {},
  isContextLost: () => false,
  flush: () => {},
};

beforeEach(() => {
  wanted = [];
  nowMs = 0;
  isDrawn = true;
  vi.stubGlobal("requestAnimationFrame", (callback: (timeMs: number) => void) =>
    wanted.push(callback),
  );
  vi.spyOn(performance, "now").mockImplementation(() => nowMs);
  document.body.innerHTML = '<canvas data-engine="three.js"></canvas>';
  const canvas = document.querySelector("canvas")!;
  canvas.getContext = (() => context) as unknown as HTMLCanvasElement["getContext"];
});

/** Let the browser draw its frames for some time, 60 of them in a second. */
function pass(ms: number): void {
  for (const endMs = nowMs + ms; nowMs < endMs; nowMs += 1000 / 60)
    for (const callback of wanted.splice(0)) callback(nowMs);
}

/** A scene that wants to be drawn all the time; returns how often it was. */
function scene(): { count: number } {
  const drawn = { count: 0 };
  const draw = () => {
    drawn.count += 1;
    requestAnimationFrame(draw);
  };
  requestAnimationFrame(draw);
  return drawn;
}

test("callbacks run in their order, and one that is cancelled does not run", () => {
  new RenderThrottle(() => {});
  const ran: string[] = [];
  requestAnimationFrame(() => {
    ran.push("first");
    cancelAnimationFrame(second);
  });
  const second = requestAnimationFrame(() => ran.push("second"));
  requestAnimationFrame(() => {
    ran.push("third");
    requestAnimationFrame(() => ran.push("next frame"));
    ran.push("end of the frame");
  });
  pass(100);
  expect(ran).toEqual(["first", "third", "end of the frame", "next frame"]);
});

test("a scene that is drawn fast is drawn as often as the browser can", () => {
  new RenderThrottle(() => {});
  const drawn = scene();
  pass(1000);
  expect(drawn.count).toBeGreaterThanOrEqual(59);
});

test("a slow frame is waited for, and then rested from for as long", () => {
  const onDrawn = vi.fn();
  new RenderThrottle(onDrawn);
  const drawn = scene();
  isDrawn = false;
  pass(400);
  const { count } = drawn;
  expect(onDrawn).not.toHaveBeenCalled();
  isDrawn = true;
  pass(300);
  expect(onDrawn).toHaveBeenCalledTimes(1);
  expect(drawn.count).toBe(count);
  pass(200);
  expect(drawn.count).toBeGreaterThan(count);
});

test("a paused scene is not drawn, and is once it is paused no more", () => {
  const throttle = new RenderThrottle(() => {});
  const drawn = scene();
  throttle.paused = true;
  pass(500);
  expect(drawn.count).toBe(0);
  throttle.paused = false;
  pass(50);
  expect(drawn.count).toBeGreaterThan(0);
});
