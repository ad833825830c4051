import { expect, test } from "vitest";
import { lengthText } from "../../src/scene/map_picture";
import { labelPlaces, MapTrails, MapView, type Pixel } from "../../src/scene/map_view";

const SIZE = { width: 300, height: 200 };

function view(spanM: number): MapView {
  const made = new MapView();
  made.setSpan(spanM);
  made.size = SIZE;
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
      const [x, y] = map.toFloor(map.toPixels(place));
      expect(Math.hypot(x - place[0], y - place[1])).toBeLessThan(0.001);
    }
  }
});

test("World x is up and y is left, and a metre is as long both ways.", () => {
  const map = view(4);
  const [right, down] = map.toPixels([0, 0]);
  expect([right, down]).toEqual([150, 100]);
  expect(map.toPixels([1, 0])).toEqual([right, down - map.scale]);
  expect(map.toPixels([0, 1])).toEqual([right - map.scale, down]);
});

test("The map rests while the robot is near its middle, and never loses it.", () => {
  const map = view(4);
  const before = map.toPixels([0, 0]);
  map.follow([0.9, -0.9]);
  expect(map.toPixels([0, 0])).toEqual(before);
  for (let x = 0; x < 20; x += 0.37) {
    map.follow([x, -x]);
    const [right, down] = map.toPixels([x, -x]);
    expect(Math.abs(right - 150)).toBeLessThanOrEqual(50.001);
    expect(Math.abs(down - 100)).toBeLessThanOrEqual(50.001);
  }
});

test("Zoom keeps the place under the pointer and stays within its limits.", () => {
  const map = view(4);
  map.follow([3, 5]);
  const at: Pixel = [40, 160];
  const before = map.toFloor(at);
  map.zoom(1.7, at);
  expect(map.toFloor(at)[0]).toBeCloseTo(before[0], 2);
  expect(map.toFloor(at)[1]).toBeCloseTo(before[1], 2);
  expect(map.spanM).toBeCloseTo(4 / 1.7);
  map.zoom(1e6);
  const nearest = map.spanM;
  map.zoom(1.1);
  expect(map.spanM).toBe(nearest);
  map.zoom(1e-9);
  expect(map.spanM).toBe(64);
});

test("A drag moves the floor with the pointer.", () => {
  const map = view(4);
  const place = map.toFloor([100, 50]);
  map.pan([30, -20]);
  const [right, down] = map.toPixels(place);
  expect(right).toBeCloseTo(130, 1);
  expect(down).toBeCloseTo(30, 1);
});

test("The scale bar has a round length and fits into the picture.", () => {
  for (const spanM of [0.5, 1, 2.7, 4, 13, 32, 64]) {
    const map = view(spanM);
    expect(map.barM().toPrecision(1)).toMatch(/^0?[.0]*[125]0*(e\+1)?$/);
    expect(map.barM() * map.scale).toBeLessThanOrEqual(0.4 * SIZE.width + 1e-9);
    expect(map.barM() * map.scale).toBeGreaterThan(0.1 * SIZE.width);
  }
  expect([lengthText(0.5), lengthText(2)]).toEqual(["50 cm", "2 m"]);
});

test("A trail extends that of the server, and breaks where the pose was set.", () => {
  const trails = new MapTrails();
  const at = (x: number, y: number) =>
    trails.extend([{ id: "tsd", pose: [x, y, 0], reach_m: 0.2, stale: false }]);
  trails.replace({ tsd: [[0, 0]] });
  at(0.04, 0);
  expect(trails.of("tsd")).toHaveLength(1);
  at(0.06, 0);
  at(3, 0);
  expect(trails.of("tsd")).toEqual([[0, 0], [0.06, 0], null, [3, 0]]);
  for (let i = 0; i < 3000; i++) at(3 + i / 10, 0);
  expect(trails.of("tsd").length).toBeLessThanOrEqual(800);
  expect(trails.of("other")).toEqual([]);
});

test("Names of robots never overlap, even if the robots do.", () => {
  const width = 48;
  for (const apartPx of [0, 3, 10, 25, 60, 200])
    for (const [stepX, stepY] of [
      [1, 0],
      [0, 1],
      [0.7, -0.7],
    ] as Pixel[]) {
      const robots = [0, 1, 2, 3, 4].map((i) => ({
        at: [100 + i * apartPx * stepX, 80 + i * apartPx * stepY] as Pixel,
        radius: 9,
        width,
      }));
      const places = labelPlaces(robots);
      for (const [i, a] of places.entries())
        for (const b of places.slice(i + 1))
          expect(Math.abs(a[0] - b[0]) >= width || Math.abs(a[1] - b[1]) >= 12).toBe(true);
    }
});

test("A name avoids other robots if there is room.", () => {
  const [first, second] = labelPlaces([
    { at: [100, 80], radius: 9, width: 30 },
    { at: [100, 110], radius: 9, width: 30 },
  ]);
  expect(first).toEqual([100, 80 - 9 - 14]); // The other robot is below.
  expect(second).toEqual([100, 110 + 9 + 24]);
});

test("A name is not cut off at the edge of the picture.", () => {
  const robot = (x: number) => ({ at: [x, 80] as Pixel, radius: 9, width: 60 });
  const [right, left, beyond] = labelPlaces([robot(290), robot(5), robot(400)], [0, 300]);
  expect(right![0] + 30).toBeLessThanOrEqual(300);
  expect(left![0] - 30).toBeGreaterThanOrEqual(0);
  expect(beyond![0]).toBe(400); // Its robot is outside too.
});
