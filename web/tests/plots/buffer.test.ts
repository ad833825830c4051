import { expect, test } from "vitest";
import { PlotBuffer } from "../../src/plots/buffer.ts";
import { MAX_FIELDS } from "../../src/plots/layout.ts";

function numbered(buffer: PlotBuffer, from: number, count: number): void {
  for (let i = from; i < from + count; i += 1)
    buffer.add(i / 20, (name) => (name === "i" ? i : -i));
}

test("A buffer keeps the latest samples in order, in the arrays that it began with.", () => {
  const buffer = new PlotBuffer(100, 10);
  buffer.select(["i", "minus"]);
  const memory = () =>
    [buffer.times, buffer.values("i"), buffer.values("minus")].map((v) => v.buffer);
  const before = memory();
  for (let i = 0; i < 1000; i += 1) {
    numbered(buffer, i, 1);
    expect(buffer.length).toBeGreaterThanOrEqual(Math.min(i + 1, 100));
    expect(buffer.length).toBeLessThanOrEqual(110);
    expect(buffer.newestS).toBe(i / 20);
  }
  const expected = Array.from({ length: buffer.length }, (_, k) => 1000 - buffer.length + k);
  expect([...buffer.values("i")]).toEqual(expected);
  expect([...buffer.values("minus")]).toEqual(expected.map((i) => -i));
  expect([...buffer.times]).toEqual(expected.map((i) => i / 20));
  memory().forEach((array, i) => expect(array).toBe(before[i]));
});

test("Ten minutes of sixteen fields at 20 Hz take two megabytes, however long it runs.", () => {
  const buffer = new PlotBuffer();
  const names = Array.from({ length: MAX_FIELDS }, (_, i) => `field ${i}`);
  buffer.select(names);
  numbered(buffer, 0, 30_000);
  const views = [buffer.times, ...names.map((name) => buffer.values(name))];
  expect(views.reduce((sum, view) => sum + view.buffer.byteLength, 0)).toBeLessThan(2e6);
  expect(buffer.newestS - buffer.times[0]!).toBeGreaterThanOrEqual(600 - 0.05);
});

test("A column chosen later begins empty, and one that is kept continues.", () => {
  const buffer = new PlotBuffer();
  buffer.select(["i"]);
  numbered(buffer, 0, 3);
  buffer.select(["i", "late"]);
  numbered(buffer, 3, 1);
  expect([...buffer.values("i")]).toEqual([0, 1, 2, 3]);
  expect([...buffer.values("late")]).toEqual([NaN, NaN, NaN, -3]);
  buffer.select(["late"]);
  expect([...buffer.values("i")].every(Number.isNaN)).toBe(true);
});

test("A span has the samples from its first to its last moment, whatever was dropped.", () => {
  const buffer = new PlotBuffer(100, 10);
  buffer.select(["i"]);
  for (let i = 0; i < 250; i += 1) {
    numbered(buffer, i, 1);
    for (const [fromS, toS] of [
      [-1, 0],
      [0, 100],
      [i / 20, i / 20],
      [(i - 7.5) / 20, (i - 2) / 20],
      [i, i + 1],
    ] as const) {
      const inside = [...buffer.times].filter((time) => time >= fromS && time <= toS);
      expect([...buffer.times.subarray(...buffer.places(fromS, toS))]).toEqual(inside);
    }
  }
});

test("A sample that is not newer is ignored.", () => {
  const buffer = new PlotBuffer();
  buffer.select(["i"]);
  [1, 1, 0.5].forEach((time, i) => buffer.add(time, () => i));
  expect([[...buffer.times], [...buffer.values("i")]]).toEqual([[1], [0]]);
});

test("CSV has units, times in µs, and each value of the span as it was received.", () => {
  const buffer = new PlotBuffer();
  const fields = [
    { name: "twist.vx", unit: "m/s" },
    { name: "modules.module1.tilt", unit: "°" },
  ];
  buffer.select(fields.map(({ name }) => name));
  const values = [0.1 + 0.2, NaN, -1e-7];
  const times = [10.050000000000279, 11.05, 12.05];
  values.forEach((value, i) => buffer.add(times[i]!, (name) => (name === "twist.vx" ? value : i)));
  expect(buffer.csv(fields, 10.05, 11.05)).toBe(
    "robot_time [s],twist.vx [m/s],modules.module1.tilt [deg]\n" +
      "10.05,0.30000000000000004,0\n11.05,nan,1\n",
  );
  expect(buffer.csv(fields, 20, 30).split("\n")).toHaveLength(2);
});
