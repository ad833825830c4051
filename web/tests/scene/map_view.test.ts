import { expect, test } from "vitest";
import { extended, fitting, lengthText, MapView, type Trail } from "../../src/scene/map_view";
import type { Pixel } from "../../src/scene/pick";

const SIZE: Pixel = [300, 200];

function view(spanM: number): MapView {
  const made = new MapView();
  made.span.value = spanM;
  return made;
}

test("A click is taken for the place that is drawn there, at every scale and place.", () => {
  for (const spanM of [1, 4, 64]) {
    const map = view(spanM);
    map.follow([12.3, -4.5]);
    for (const place of [
      [12.3, -4.5],
      [12.3 + 0.3 * spanM, -4.5 - 0.4 * spanM],
    ] as Pixel[]) {
      const [x, y] = map.toPlace(map.toPixel(place, SIZE), SIZE);
      expect(Math.hypot(x - place[0], y - place[1])).toBeLessThan(0.001);
    }
  }
});

test("World x is up and y is left, and a metre is as long both ways.", () => {
  const map = view(4);
  const [right, down] = map.toPixel([0, 0], SIZE);
  expect([right, down]).toEqual([150, 100]);
  expect(map.toPixel([1, 0], SIZE)).toEqual([right, down - 50]);
  expect(map.toPixel([0, 1], SIZE)).toEqual([right - 50, down]);
});

test("The map rests while the robot is near its middle, and never loses it.", () => {
  const map = view(4);
  const before = map.toPixel([0, 0], SIZE);
  map.follow([0.9, -0.9]);
  expect(map.toPixel([0, 0], SIZE)).toEqual(before);
  for (let x = 0; x < 20; x += 0.37) {
    map.follow([x, -x]);
    const [right, down] = map.toPixel([x, -x], SIZE);
    expect(Math.abs(right - 150)).toBeLessThanOrEqual(50.001);
    expect(Math.abs(down - 100)).toBeLessThanOrEqual(50.001);
  }
});

test("Zoom keeps the middle and stays within its limits.", () => {
  const map = view(4);
  map.follow([3, 5]);
  const before = map.toPlace([150, 100], SIZE);
  map.zoom(1.7);
  expect(map.toPlace([150, 100], SIZE)).toEqual(before);
  expect(map.span.value).toBeCloseTo(4 / 1.7);
  map.zoom(1e6);
  const nearest = map.span.value;
  map.zoom(1.1);
  expect(map.span.value).toBe(nearest);
  map.zoom(1e-9);
  expect(map.span.value).toBe(64);
});

test("The scale bar has a round length and fits into the picture.", () => {
  for (const spanM of [0.5, 1, 2.7, 4, 13, 32, 64]) {
    const metres = view(spanM).gridM();
    expect(Number.isInteger(Math.log10(metres))).toBe(true);
    expect(metres).toBeLessThanOrEqual(spanM / 2);
    expect(metres).toBeGreaterThan(spanM / 21);
  }
  expect([lengthText(0.5), lengthText(2)]).toEqual(["50 cm", "2 m"]);
});

test("A trail extends that of the server, and breaks where the pose was set.", () => {
  let trail: Trail = [[0, 0]];
  const at = (x: number) => (trail = extended(trail, [x, 0]));
  at(0.04);
  expect(trail).toHaveLength(1);
  at(0.06);
  at(3);
  expect(trail).toEqual([[0, 0], [0.06, 0], null, [3, 0]]);
  for (let i = 0; i < 3000; i++) at(3 + i / 10);
  expect(trail.length).toBeLessThanOrEqual(800);
});

test("Names on the map neither overlap nor are cut off at its edge.", () => {
  const named = (text: string, ...at: [number, number]) => ({ text, at });
  const shown = fitting(
    [
      named("kiwi", 150, 50),
      named("mecanum", 160, 55),
      named("below", 150, 80),
      named("at the left edge", 2, 120),
      named("at the right edge", 299, 120),
      named("outside", 310, 50),
      named("under the edge", 150, 195),
    ],
    SIZE,
  );
  expect(shown.map(({ text }) => text)).toEqual([
    "kiwi",
    "below",
    "at the left edge",
    "at the right edge",
  ]);
  for (const { text, at } of shown) {
    expect(at[0]).toBeGreaterThanOrEqual(4 * text.length);
    expect(at[0]).toBeLessThanOrEqual(300 - 4 * text.length);
  }
});
