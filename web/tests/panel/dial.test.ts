import { expect, test } from "vitest";
import { endOfAxle, ringRange, tipOf } from "../../src/panel/dial";

test("An axle that tilts ahead points up on its dial, one that tilts left points left.", () => {
  expect(endOfAxle({ tilt: 5, direction: 0 }, 10)).toEqual({ right: 0, down: -18 });
  const left = endOfAxle({ tilt: 5, direction: 90 }, 10);
  expect(left.right).toBeCloseTo(-18);
  expect(left.down).toBeCloseTo(0);
});

test("A push ahead points up on its dial, a push to the left points left.", () => {
  expect(tipOf([1, 0], 2)).toEqual({ right: 0, down: -18 });
  expect(tipOf([0, 1], 2)).toEqual({ right: -18, down: 0 });
  expect(tipOf([-1, -1], 2)).toEqual({ right: 18, down: 18 });
});

test("An upright axle and a robot at rest are drawn in the centre.", () => {
  expect(endOfAxle({ tilt: 0, direction: null }, 5)).toEqual({ right: 0, down: 0 });
  expect(tipOf([0, 0], 0)).toEqual({ right: 0, down: 0 });
});

test("Nothing is drawn outside the ring.", () => {
  const { right, down } = endOfAxle({ tilt: 40, direction: 30 }, 30);
  expect(Math.hypot(right, down)).toBeCloseTo(36);
  const tip = tipOf([3, 4], 1);
  expect(Math.hypot(tip.right, tip.down)).toBeCloseTo(36);
});

test.each([
  [0, 5],
  [4.9, 5],
  [5.1, 10],
  [12, 20],
  [29, 30],
  [34, 40],
])("A tilt of %s° needs a ring of %s°.", (tilt, range) => {
  expect(ringRange([0, tilt, 1], 0)).toBe(range);
});

test("A tilt near the end of a range does not switch the ring back and forth.", () => {
  expect(ringRange([5.1], 5)).toBe(10);
  expect(ringRange([4.9], 10)).toBe(10);
  expect(ringRange([4.4], 10)).toBe(5);
  expect(ringRange([4.9], 5)).toBe(5);
});
