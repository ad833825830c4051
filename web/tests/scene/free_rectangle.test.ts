import { afterEach, expect, test, vi } from "vitest";
import { type Box, freeRectangle, watchFreeRectangle } from "../../src/scene/free_rectangle";

const PICTURE: Box = { left: 100, top: 50, right: 1100, bottom: 650 };
const MAP: Box = { left: 112, top: 500, right: 292, bottom: 638 };
const MODES: Box = { left: 112, top: 62, right: 292, bottom: 98 };
const CAMERAS: Box = { left: 880, top: 62, right: 1088, bottom: 98 };
const LEGEND: Box = { left: 700, top: 610, right: 1088, bottom: 638 };

function pixels({ left, top, right, bottom }: Box): Box {
  return {
    left: 100 + 1000 * left,
    top: 50 + 600 * top,
    right: 100 + 1000 * right,
    bottom: 50 + 600 * bottom,
  };
}

afterEach(() => {
  vi.useRealTimers();
  document.body.innerHTML = "";
});

test("Without covers, the whole picture is free.", () => {
  expect(freeRectangle(PICTURE, [])).toEqual({ left: 0, top: 0, right: 1, bottom: 1 });
});

test("The free rectangle touches none of the covers and is inside the picture.", () => {
  for (const covers of [[MODES, CAMERAS], [MAP], [MODES, CAMERAS, MAP, LEGEND]]) {
    const free = pixels(freeRectangle(PICTURE, covers));
    expect(free.left).toBeGreaterThanOrEqual(PICTURE.left);
    expect(free.bottom).toBeLessThanOrEqual(PICTURE.bottom);
    for (const cover of covers) {
      const apart =
        free.right <= cover.left + 1 ||
        free.left >= cover.right - 1 ||
        free.bottom <= cover.top + 1 ||
        free.top >= cover.bottom - 1;
      expect(apart).toBe(true);
    }
  }
});

test("The room beside the map counts for more than the room above it in a wide picture.", () => {
  const free = pixels(freeRectangle(PICTURE, [MODES, CAMERAS, MAP, LEGEND]));
  expect(free.bottom - free.top).toBeCloseTo(610 - 98, 0);
  expect(free.left).toBeCloseTo(292, 0);
});

test("On a phone held sideways the robot is large, and nearly in the middle.", () => {
  const picture = { left: 0, top: 48, right: 844, bottom: 390 };
  const speed = { left: 20, top: 60, right: 230, bottom: 102 };
  const heading = { left: 778, top: 60, right: 824, bottom: 92 };
  const stick = { left: 22, top: 236, right: 158, bottom: 372 };
  const stop = { left: 326, top: 304, right: 518, bottom: 376 };
  const turn = { left: 656, top: 252, right: 824, bottom: 345 };
  const modes = { left: 594, top: 52, right: 772, bottom: 100 };
  const free = freeRectangle(picture, [stop, stick, speed, heading, turn, modes]);
  expect(0.5 * (free.left + free.right)).toBeCloseTo(0.5, 1);
  expect(free.bottom - free.top).toBeGreaterThan(0.7);
  expect(free.right - free.left).toBeGreaterThan(0.4);
});

test("Covers outside the picture do not count, as the deck below it.", () => {
  const deck = { left: 100, top: 650, right: 1100, bottom: 800 };
  expect(freeRectangle(PICTURE, [deck]).bottom).toBe(1);
  expect(freeRectangle(PICTURE, [{ ...deck, top: 530 }]).bottom).toBeCloseTo(0.8);
});

test("A picture that is covered wholly, or but for a rim, is reported whole.", () => {
  const rim = { ...PICTURE, top: PICTURE.top + 60 };
  expect(freeRectangle(PICTURE, [rim])).toEqual({ left: 0, top: 0, right: 1, bottom: 1 });
  expect(freeRectangle(PICTURE, [PICTURE])).toEqual({ left: 0, top: 0, right: 1, bottom: 1 });
});

test("A rectangle is reported only once it no longer changes.", () => {
  vi.useFakeTimers();
  document.body.innerHTML = '<main class="view"><div data-covers></div></main>';
  const view = document.querySelector("main")!;
  const cover = document.querySelector("div")!;
  view.getBoundingClientRect = () => new DOMRect(0, 0, 1000, 600);
  let height = 0;
  cover.getBoundingClientRect = () => new DOMRect(0, 0, 1000, (height += 30));
  const reports: Box[] = [];
  const end = watchFreeRectangle(view, (free) => reports.push(free));
  vi.advanceTimersByTime(1000);
  expect(reports).toEqual([]);
  cover.getBoundingClientRect = () => new DOMRect(0, 0, 1000, 60);
  vi.advanceTimersByTime(1000);
  expect(reports.at(-1)).toEqual({ left: 0, top: 0.1, right: 1, bottom: 1 });
  const count = reports.length;
  end();
  vi.advanceTimersByTime(1000);
  expect(reports).toHaveLength(count);
});
