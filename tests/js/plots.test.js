import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { connect, pass } from "./browser.js";

const STATIC = "../../src/tsd_twin/dashboard/static";
const { PlotBuffer } = await import(`${STATIC}/plot_buffer.js`);
const { fieldsOf, valueOf } = await import(`${STATIC}/plot_fields.js`);
const { MAX_FIELDS, Recorder } = await import(`${STATIC}/plot_recorder.js`);

const AXES = [
  { name: "vx", symbol: "vx", unit: "m/s" },
  { name: "vy", symbol: "vy", unit: "m/s" },
  { name: "omega", symbol: "ω", unit: "rad/s" },
];
const ROBOT = {
  t: "robot",
  id: "tsd",
  panel: "gimbals",
  twist_axes: AXES,
  twist_scale_m: 1,
  modules: ["module1", "module2"],
  wheels: [],
  plot_fields: ["requested.vx_mps", "joints.module1_alpha.position_rad", "odom.sigma.heading_rad"],
};
const STATE = {
  robot_s: 1,
  rtt_ms: null,
  pose: [1, 2, 0.5],
  twist: [0.1, 0.2, 0.3],
  commanded: [0.4, 0.5, 0.6],
  truth: null,
  modules: [
    { alpha: 1, alpha_setpoint: 2, tilt: 3, rpm: 2500, axle: [0.1, 0.2], spinning: true },
    { alpha: 4, alpha_setpoint: 5, tilt: 6, rpm: 2510, axle: [0.3, 0.4], spinning: true },
  ],
  wheels: [],
  sphere: null,
  plot: {},
};
const STATUS = {
  consistency: { residual_mps: 0.012, suspect: null, level: 0.4, contributions: { module1: 0.3 } },
  hardware: { kind: "sim", battery_v: 12.3, pulse_us: [1500, 1501] },
};

function numbered(buffer, from, count) {
  for (let i = from; i < from + count; i += 1)
    buffer.add(i / 20, (name) => (name === "i" ? i : -i));
}

test("a buffer keeps the newest samples in order, in the arrays that it began with", () => {
  const buffer = new PlotBuffer(100, 10);
  buffer.select(["i", "minus"]);
  const memory = [buffer.times.buffer, buffer.values("i").buffer, buffer.values("minus").buffer];
  for (let i = 0; i < 1000; i += 1) {
    numbered(buffer, i, 1);
    assert.ok(buffer.length >= Math.min(i + 1, 100) && buffer.length <= 110);
    assert.equal(buffer.newestS, i / 20);
  }
  const expected = Array.from({ length: buffer.length }, (_, k) => 1000 - buffer.length + k);
  assert.deepEqual([...buffer.values("i")], expected);
  assert.deepEqual(
    [...buffer.values("minus")],
    expected.map((i) => -i),
  );
  assert.deepEqual(
    [...buffer.times],
    expected.map((i) => i / 20),
  );
  assert.deepEqual(
    [buffer.times.buffer, buffer.values("i").buffer, buffer.values("minus").buffer],
    memory,
  );
});

test("ten minutes of sixteen fields at 20 Hz take two megabytes, however long it runs", () => {
  const buffer = new PlotBuffer();
  const names = Array.from({ length: MAX_FIELDS }, (_, i) => `field ${i}`);
  buffer.select(names);
  numbered(buffer, 0, 30_000);
  const bytes = [buffer.times, ...names.map((name) => buffer.values(name))]
    .map((view) => view.buffer.byteLength)
    .reduce((sum, each) => sum + each, 0);
  assert.ok(bytes < 2e6, `${bytes} bytes`);
  assert.ok(buffer.newestS - buffer.times[0] >= 600 - 0.05);
});

test("a column that is chosen later begins empty, one that is kept goes on", () => {
  const buffer = new PlotBuffer();
  buffer.select(["i"]);
  numbered(buffer, 0, 3);
  buffer.select(["i", "late"]);
  numbered(buffer, 3, 1);
  assert.deepEqual([...buffer.values("i")], [0, 1, 2, 3]);
  assert.deepEqual([...buffer.values("late")], [NaN, NaN, NaN, -3]);
  buffer.select(["late"]);
  assert.ok(buffer.values("i").every(Number.isNaN));
});

test("a span has the samples from its first to its last moment, whatever was dropped", () => {
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
    ]) {
      const [from, to] = buffer.places(fromS, toS);
      const inside = [...buffer.times].filter((time) => time >= fromS && time <= toS);
      assert.deepEqual([...buffer.times.subarray(from, to)], inside);
    }
  }
});

test("a sample that is not newer is ignored", () => {
  const buffer = new PlotBuffer();
  buffer.select(["i"]);
  buffer.add(1, () => 1);
  buffer.add(1, () => 2);
  buffer.add(0.5, () => 3);
  assert.deepEqual([[...buffer.times], [...buffer.values("i")]], [[1], [1]]);
});

test("CSV has the units, and each number of the span as it was received", () => {
  const buffer = new PlotBuffer();
  const fields = [
    { name: "twist.vx", unit: "m/s" },
    { name: "modules.module1.tilt", unit: "°" },
  ];
  buffer.select(fields.map(({ name }) => name));
  const values = [0.1 + 0.2, NaN, -1e-7];
  values.forEach((value, i) => buffer.add(10.05 + i, (name) => (name === "twist.vx" ? value : i)));
  assert.equal(
    buffer.csv(fields, 10.05, 11.05),
    "robot_time [s],twist.vx [m/s],modules.module1.tilt [deg]\n" +
      "10.05,0.30000000000000004,0\n11.05,nan,1\n",
  );
  assert.equal(buffer.csv(fields, 20, 30).split("\n").length, 2);
});

test("every number of a state is a field with unit, and its value is found by its name", () => {
  const state = { ...STATE, status: STATUS, link: { round_trip_ms: 12 } };
  const fields = fieldsOf(ROBOT, state);
  const expected = {
    "pose.x": ["m", 1, "Position"],
    "pose.heading": ["rad", 0.5, "Heading"],
    "twist.vy": ["m/s", 0.2, "Velocity"],
    "commanded.vy": ["m/s", 0.5, "Velocity"],
    "commanded.omega": ["rad/s", 0.6, "Turn rate"],
    "modules.module2.alpha": ["°", 4, "Alpha"],
    "modules.module2.alpha_setpoint": ["°", 5, "Alpha"],
    "modules.module1.rpm": ["rpm", 2500, "Rpm"],
    "status.consistency.residual_mps": ["m/s", 0.012, "Consistency residual"],
    "status.consistency.contributions.module1": ["", 0.3, "Contributions module1"],
    "status.hardware.battery_v": ["V", 12.3, "Hardware battery"],
    "status.hardware.pulse_us.2": ["µs", 1501, "Pulse us 2"],
    "link.round_trip_ms": ["ms", 12, "Link round trip"],
  };
  for (const [name, [unit, value, title]] of Object.entries(expected)) {
    const field = fields.get(name);
    assert.deepEqual([name, field?.unit, field?.title], [name, unit, title]);
    assert.equal(valueOf(field, state), value);
  }
  assert.ok([...fields.keys()].every((name) => !/kind|suspect|spinning|robot_s|truth/.test(name)));
});

test("a set-point has plot and colour of the measured value, and a line of its own", () => {
  const fields = fieldsOf(ROBOT, STATE);
  for (const [set, measured] of [
    ["commanded.vx", "twist.vx"],
    ["requested.vx_mps", "twist.vx"],
    ["modules.module1.alpha_setpoint", "modules.module1.alpha"],
  ]) {
    const [a, b] = [fields.get(set), fields.get(measured)];
    assert.deepEqual([a.title, a.unit, a.part], [b.title, b.unit, b.part]);
    assert.notEqual(a.line, b.line);
  }
});

function recorder(memory = {}) {
  const stored = new Map(Object.entries(memory));
  globalThis.localStorage = {
    getItem: (key) => stored.get(key) ?? null,
    setItem: (key, value) => stored.set(key, value),
  };
  const page = connect();
  const made = new Recorder(page.link);
  page.say(ROBOT);
  let robot_s = 0;
  const take = (fields = {}) =>
    page.state(STATUS, { ...STATE, robot_s: (robot_s += 0.05), ...fields });
  return { ...page, recorder: made, sample: take, stored };
}

test("plots go on when the robot's description changes, and begin anew with another robot", () => {
  const { recorder: plots, say, sample } = recorder();
  plots.choose(["twist.vx", "modules.module3.tilt"]);
  sample();
  const modules = [...STATE.modules, { tilt: 9 }];
  say({ ...ROBOT, modules: ["module1", "module2", "module3"] });
  sample({ modules });
  assert.deepEqual([...plots.buffer.values("twist.vx")], [0.1, 0.1]);
  assert.deepEqual([...plots.buffer.values("modules.module3.tilt")], [NaN, 9]);
  say({ ...ROBOT, id: "other" });
  assert.equal(plots.buffer.length, 0);
  assert.notDeepEqual(plots.names, ["twist.vx", "modules.module3.tilt"]);
  say(ROBOT);
  assert.deepEqual(plots.names, ["twist.vx", "modules.module3.tilt"]);
});

test("plots begin anew when the robot's clock does", () => {
  const { recorder: plots, sample } = recorder();
  sample({ robot_s: 100 });
  sample({ robot_s: 3 });
  assert.deepEqual([...plots.buffer.times], [3]);
});

test("a field that was null is recorded from its first value on, and stays when it is null again", () => {
  const { recorder: plots, sample } = recorder();
  plots.choose(["truth.x"]);
  sample();
  assert.deepEqual(plots.fields, []);
  pass(1000);
  sample({ truth: [7, 8, 9] });
  sample();
  assert.deepEqual(
    plots.fields.map(({ name }) => name),
    ["truth.x"],
  );
  assert.deepEqual([...plots.buffer.values("truth.x")], [NaN, 7, NaN]);
});

test("what is not in every state is requested until it comes, and no longer than it is plotted", () => {
  const { recorder: plots, sample, take } = recorder();
  const asked = () => take("plot_fields").map(({ names }) => names);
  plots.choose(["twist.vx"]);
  sample();
  assert.deepEqual(asked(), []);
  plots.choose(["twist.vx", "requested.vx_mps"]);
  sample();
  sample();
  assert.deepEqual(asked(), [["requested.vx_mps"]]);
  pass(1000);
  sample();
  assert.deepEqual(asked(), [["requested.vx_mps"]]);
  sample({ plot: { "requested.vx_mps": 0.7 } });
  pass(1000);
  sample({ plot: { "requested.vx_mps": 0.8 } });
  assert.deepEqual(asked(), []);
  assert.deepEqual([...plots.buffer.values("requested.vx_mps")], [NaN, NaN, NaN, NaN, 0.7, 0.8]);
  plots.choose(["twist.vx"]);
  sample({ plot: { "requested.vx_mps": 0.8 } });
  assert.deepEqual(asked(), [[]]);
});

test("no more than sixteen fields are plotted", () => {
  const { recorder: plots } = recorder();
  plots.choose(Array.from({ length: 40 }, (_, i) => `field${i}`));
  assert.equal(plots.names.length, MAX_FIELDS);
});

test("choice and window are kept in the browser, by robot; what cannot be read is left out", () => {
  const first = recorder();
  first.recorder.choose(["twist.vx"]);
  first.recorder.windowS = 120;
  const again = recorder(Object.fromEntries(first.stored)).recorder;
  assert.deepEqual([again.names, again.windowS], [["twist.vx"], 120]);
  again.choose(null);
  assert.ok(again.names.includes("link.round_trip_ms"));
  const unreadable = [
    "",
    "null",
    "7",
    "{",
    '{"windowS":"x","fields":{"tsd":3}}',
    '{"fields":null}',
  ];
  for (const text of [...unreadable, '{"windowS":0}', '{"windowS":1e9}'])
    assert.equal(recorder({ "tsd.plots": text }).recorder.windowS, 20, text);
});

test("the plot library is the one of the lock file, unchanged", () => {
  const ours = new URL(`${STATIC}/vendor/`, import.meta.url);
  const theirs = new URL("../../web/node_modules/uplot/", import.meta.url);
  for (const [copy, original] of [
    ["uPlot.iife.min.js", "dist/uPlot.iife.min.js"],
    ["uPlot.min.css", "dist/uPlot.min.css"],
    ["uPlot.LICENSE", "LICENSE"],
  ])
    assert.deepEqual(readFileSync(new URL(copy, ours)), readFileSync(new URL(original, theirs)));
});
