import { expect, test } from "vitest";
import { ticks } from "../../src/timeline/clock";
import { grouped } from "../../src/timeline/happenings";
import { linePath, spans } from "../../src/timeline/recorded";

/** Random numbers from 0 to 1 that are the same in each run. */
function random(seed: number): () => number {
  let state = seed;
  return () => (state = (16807 * state) % 2147483647) / 2147483647;
}

test("Labels of random events never overlap, stay inside, and count each event once, in order", () => {
  for (let seed = 1; seed <= 300; seed++) {
    const next = random(seed);
    const least = 0.05 + 0.3 * next();
    const events = Array.from({ length: Math.ceil(60 * next() ** 2) }, (_, number) => ({
      number,
      share: next(),
    })).sort((one, other) => one.share - other.share);
    const groups = grouped(events, least);
    let end = 0;
    for (const { left, width } of groups) {
      expect(left).toBeGreaterThanOrEqual(end - 1e-9);
      expect(width).toBeGreaterThanOrEqual(least - 1e-9);
      end = left + width;
    }
    expect(end).toBeLessThanOrEqual(1 + 1e-9);
    expect(groups.flatMap(({ items }) => items)).toEqual(events);
  }
});

test("Events with room for their labels are not merged", () => {
  const events = [0.01, 0.3, 0.6].map((share) => ({ share }));
  expect(grouped(events, 0.2).map(({ items }) => items)).toEqual(events.map((event) => [event]));
});

test("Spans cover the whole time without overlap and hold the values of their samples", () => {
  for (let seed = 1; seed <= 100; seed++) {
    const next = random(seed);
    const samples = Array.from({ length: 2 + Math.floor(50 * next()) }, () =>
      next() < 0.2 ? null : Math.floor(3 * next()),
    );
    const joined = spans(samples);
    expect(joined[0]!.from).toBe(0);
    expect(joined.at(-1)!.to).toBe(1);
    joined.slice(1).forEach((span, i) => {
      expect(span.from).toBe(joined[i]!.to);
      expect(span.value).not.toBe(joined[i]!.value);
    });
    samples.forEach((value, i) => {
      const at = i / (samples.length - 1);
      expect(joined.find((span) => span.from <= at && at <= span.to)!.value).toBe(value);
    });
  }
});

test("A line is interrupted where nothing was recorded", () => {
  expect(linePath([0, 1, null, 1]).match(/M/g)).toHaveLength(2);
  expect(linePath([0, 1, 0.5]).match(/M/g)).toHaveLength(1);
  expect(linePath([null, null])).toBe("");
});

test("The grid has few labels with room, and its times are round", () => {
  for (const durationS of [3, 50, 761, 3600, 90_000]) {
    const found = ticks(1_764_290_843_123, durationS);
    expect(found.length).toBeLessThanOrEqual(10);
    expect(new Set(found.map(({ text }) => text)).size).toBe(found.length);
    expect(found.every(({ tS }) => tS >= 0 && tS < 0.95 * durationS)).toBe(true);
  }
  expect(ticks(0, 0)).toEqual([]);
});
