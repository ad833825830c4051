import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { inspect } from "../../src/health/health.tsx";
import { Increases, type Level, type Row } from "../../src/health/rows.ts";
import { quality } from "../../src/store/quality.ts";
import { texts } from "../../src/text/text.ts";
import { connect, ROBOT, statusOf } from "../support/fake_link.ts";
import { sentence } from "../../src/text/reasons";

type Change = { state?: object; status?: Record<string, unknown> };

beforeEach(() => localStorage.clear());
afterEach(() => vi.useRealTimers());

const status = statusOf();
const loop = (change: object): Change => ({ status: { loop: { ...status.loop, ...change } } });
const tests = (change: object): Change => ({
  status: { consistency: { ...status.consistency, ...change } },
});
const hardware = (facts: object): Change => ({ status: { hardware: facts } });
const poses = (hz: number, far: number): Change => ({
  status: { pose_sensor: { hz, latency_s: 0.1, used: 9, found: 0, dropped: { far } } },
});
const stale = (count: number): Change => ({
  status: { command: { ...status.command, dropped: { ...status.command.dropped, stale: count } } },
});
const shadow = (measured: number): Change => ({
  state: {
    shadow: {
      compared_s: 9,
      joints: [{ name: "module1_alpha", unit: "°", measured, simulated: 0, band: 1, inside: true }],
      pose: null,
      drifts: [],
      note: null,
    },
  },
});
const drifts = (...percents: number[]): Change => ({
  state: {
    shadow: {
      joints: [],
      pose: null,
      note: null,
      drifts: percents.map((percent) => ({
        part: "wheels",
        why: { code: "wheels_slower", params: { percent } },
      })),
    },
  },
});
const limited = (...why: object[]): Change => ({
  status: { limits: { ...status.limits, why }, hardware: { battery_v: 10.9 } },
});
const low = { code: "battery_low", params: { volts: 11 } };
const trip = (rtt_ms: number, rtt_jitter_ms = 1): Change => ({ state: { rtt_ms, rtt_jitter_ms } });

const { rows } = texts().health;
/** Row; change inside and outside of its band, after a state with `before`; level outside. */
const TABLE: [string, Change, Change, Level, Change?][] = [
  [rows.trip, trip(50), trip(90), 1],
  [rows.trip, trip(50), trip(170), 2],
  [rows.jitter, trip(10, 60), trip(10, 74), 1],
  [rows.jitter, trip(10, 60), trip(10, 170), 2],
  [rows.unknownTrip, {}, { state: { rtt_ms: null } }, 2],
  [rows.rate, loop({ hz: 97 }), loop({ hz: 80.7 }), 1],
  [rows.loopJitter, loop({ jitter_p99_ms: 4.9 }), loop({ jitter_p99_ms: 75 }), 1],
  [rows.overruns, loop({ overruns: 229 }), loop({ overruns: 240 }), 1, loop({ overruns: 225 })],
  [rows.contradiction, tests({ level: 0.9 }), tests({ level: 1.1 }), 2],
  [rows.contradiction, tests({}), tests({ suspect: "module2" }), 2],
  [rows.poseRate, poses(30, 0), poses(0, 0), 1],
  [rows.poseDropped, poses(30, 55), poses(30, 70), 1, poses(30, 50)],
  [rows.dropped, stale(55), stale(70), 1, stale(50)],
  [rows.speedLimit, {}, limited({ code: "servo_hot", params: { limit_c: 70 } }), 1],
  [rows.battery, hardware({ battery_v: 12.3 }), limited(low), 1],
  [
    rows.temperature,
    hardware({ servos: { temperature_c: [40, 69] } }),
    hardware({ temperature_c: 71 }),
    1,
  ],
  [rows.servos, hardware({ alive: [true, true] }), hardware({ alive: [true, false] }), 2],
  [rows.connected, hardware({ connected: true }), hardware({ connected: false }), 2],
  [
    `${rows.serial} link broken`,
    hardware({ link: { broken: 12 } }),
    hardware({ link: { broken: 30 } }),
    1,
    hardware({ link: { broken: 9 } }),
  ],
  [rows.warning, hardware({ warnings: [] }), hardware({ warnings: ["Low supply."] }), 1],
  ["module1 alpha", shadow(-0.9), shadow(-1.1), 1],
  ["wheels", drifts(), drifts(5), 1],
];

function judge(change: Change, before?: Change) {
  const page = connect();
  page.say(ROBOT);
  const recent = new Increases();
  const report = ({ state = {}, status = {} }: Change) => {
    page.state(state, status);
    return inspect(page.link, recent);
  };
  if (before) report(before);
  page.pass(100);
  return { ...page, report: report(change), recent };
}

const named = (rows: Row[], name: string) => rows.find((row) => row.name === name);

describe.each(TABLE)("%s", (name, inside, outside, level, before) => {
  test("Inside its band it is fine.", () => {
    const { report } = judge(inside, before);
    const row = named(Object.values(report.groups).flat(), name);
    expect([row?.level ?? 0, row?.remedy ?? ""]).toEqual([0, ""]);
    expect(report.level).toBe(0);
  });

  test("Outside it opens with a remedy, and the verdict is not better.", () => {
    const { report } = judge(outside, before);
    const row = named(Object.values(report.groups).flat(), name)!;
    expect(row.level).toBe(level);
    expect(row.remedy).not.toBe("");
    expect(report.level).toBeGreaterThanOrEqual(level);
    expect(report.advice).toContain(name);
  });
});

test("Every reading with a remedy is in the table, or is judged by the bar's grade.", () => {
  const inTable = new Set(TABLE.map(([name]) => name));
  const others = new Set(["lost", "age", "compared", "drift", "serial"]);
  const names = rows as Record<string, string>;
  const missing = Object.keys(texts().health.remedies).filter((key) => !others.has(key));
  expect(missing.filter((key) => !inTable.has(names[key]!))).toEqual([]);
});

test.each([0, 1, 3, 6, 10, 25, 60])("With %i of 100 states lost, bar and Health agree.", (lost) => {
  for (const [rtt, jitter] of [
    [5, 1],
    [60, 5],
    [90, 5],
    [10, 74],
    [120, 60],
  ] as const) {
    const { link, report } = judge(trip(rtt, jitter));
    link.lost = lost / 100;
    const { level } = inspect(link, new Increases());
    const { grade, bad } = quality(link);
    expect(level >= 1, `${rtt} ${jitter}`).toBe(grade !== "good");
    if (bad) expect(level).toBe(2);
    expect(report.level).toBeLessThanOrEqual(2);
  }
});

test("A fault is never fine, and its reason is the first advice.", () => {
  const stop = { code: "servos_silent", params: { servos: "2" } };
  const { report } = judge({ status: { mode: "fault", stop } });
  expect(report.level).toBe(2);
  expect(report.advice).toMatch(/no answer/);
});

test("Without a signal, no figure is shown or judged, and the verdict says since when.", () => {
  const { link, recent, pass, report, lose } = judge(loop({ jitter_p99_ms: 75 }));
  expect(report.level).toBe(1);
  const check = (title: string) => {
    const now = inspect(link, recent);
    const all = Object.values(now.groups).flat();
    expect(all.length).toBeGreaterThan(0);
    expect(all.every(({ value, level, band }) => value === "–" && !level && !band?.at)).toBe(true);
    expect([now.level, now.title]).toEqual([2, title]);
  };
  pass(1500);
  check(texts().health.unknown.silent("1 s"));
  lose();
  pass(3000);
  check(texts().health.unknown.offline("3 s"));
});

test("A low battery shows the measured voltage, also above the threshold, and only once.", () => {
  const why = { limits: { ...status.limits, why: [low] }, hardware: { battery_v: 11.2 } };
  const all = Object.values(judge({ status: why }).report.groups).flat();
  const outside = all.filter(({ level }) => level > 0);
  expect(outside.map(({ name, value }) => [name, value])).toEqual([[rows.battery, "11.2"]]);
});

test("A counter alone is history: only its recent increase counts.", () => {
  vi.useFakeTimers();
  const recent = new Increases();
  expect(recent.of("overruns", 225)).toBe(0);
  vi.advanceTimersByTime(5000);
  expect(recent.of("overruns", 230)).toBe(5);
  vi.advanceTimersByTime(6000);
  expect(recent.of("overruns", 230)).toBe(0);
  expect(recent.of("overruns", 1)).toBe(0);
});

test("In a recording the link is not judged.", () => {
  const page = connect("drive.mcap");
  page.say(ROBOT);
  page.state({ source: "recording" });
  const { groups, level } = inspect(page.link, new Increases());
  expect([level, "link" in groups, "loop" in groups]).toEqual([0, false, true]);
});

test("Learned errors have their standard deviation and the unit of the page.", () => {
  const learned = {
    module1_wheel_share: { value: 0.012, sigma: 0.0015 },
    creep_x_mps: { value: 0.0005, sigma: 0.00025 },
    gyro_bias_rad_per_s: { value: 0.00035, sigma: 0.00012 },
  };
  const estimate = judge({ status: { learned } }).report.groups.estimate!;
  const shown = (name: string) => {
    const { value, unit } = named(estimate, `${rows.learned} ${name}`)!;
    return `${value} ${unit}`;
  };
  expect(shown("module1 wheel")).toBe("1.20 ± 0.15 %");
  expect(shown("creep x")).toBe("0.50 ± 0.25 mm/s");
  expect(shown("gyro bias")).toBe("0.020 ± 0.007 °/s");
  expect(judge({}).report.groups.estimate!.some(({ value }) => value.includes("±"))).toBe(false);
});

test("The shadow twin has a row for each joint and each part of the motion, and what it names.", () => {
  const joint = (name: string, unit: string, measured: number | null, simulated: number) => {
    return { name, unit, measured, simulated, band: 0.2, inside: true };
  };
  const joints = [
    joint("module1_alpha", "°", 1, 1.5),
    joint("module1_beta", "°", 2, 1.95),
    joint("module1_wheel", "rpm", null, 2500),
  ];
  const pose = { names: ["ahead", "left", "heading"], units: ["mm", "mm", "°"], inside: false };
  const motion = { ...pose, difference: [12, -3, 4], band: [20, 20, 2] };
  const why = { code: "servo_slower", params: { joint: "module1_alpha", percent: 30 } };
  const unknown = { part: "", why: { code: "unknown_part" } };
  const note = { code: "speeds_unmeasured" };
  const named = { drifts: [{ part: "module1_alpha", why }, unknown], note };
  const change = { state: { shadow: { compared_s: 61, joints, pose: motion, ...named } } };
  const shadow = judge(change).report.groups.shadow!;
  const shown = shadow.map(({ name, value, unit, level }) => [name, `${value} ${unit}`, level]);
  expect(shown).toEqual([
    ["module1 alpha", " ", 1],
    [rows.drift, " ", 1],
    ["module1 alpha", "−0.50 °", 1],
    ["module1 beta", "0.05 °", 0],
    ["module1 wheel", "– rpm", 0],
    [`${rows.motion} ahead`, "12 mm", 0],
    [`${rows.motion} left`, "−3 mm", 0],
    [`${rows.motion} heading`, "4.00 °", 1],
    [rows.comparedFor, "61 s", 0],
    [rows.note, `${sentence(note)} `, 0],
  ]);
  expect(shadow[0]!.remedy).toBe("The servo of module1_alpha follows 30 % slower.");
  expect(shadow[1]!.remedy).toContain("the part is not known");
  expect(judge({}).report.groups).not.toHaveProperty("shadow");
});
