import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { MAX_FIELDS, type PlotLayout } from "../../src/plots/layout.ts";
import { Recorder } from "../../src/plots/recorder.ts";
import { PlotView } from "../../src/plots/view.ts";
import { connect, ROBOT, STATE } from "../support/fake_link.ts";

beforeEach(() => localStorage.clear());
afterEach(() => {
  vi.useRealTimers();
  history.replaceState(null, "", "?");
});

const panes = (...names: string[]): PlotLayout => ({ windowS: 20, panes: [names] });

function record(recording: string | null = null) {
  const page = connect(recording);
  const recorder = new Recorder(page.link);
  page.say(ROBOT);
  let robot_s = 0;
  const sample = (fields: object = {}) => page.state({ robot_s: (robot_s += 0.05), ...fields });
  return { ...page, recorder, sample, values: (name: string) => [...recorder.buffer.values(name)] };
}

test("Plots continue when the robot's description changes, and start again with another.", () => {
  const { recorder, say, sample, values } = record();
  recorder.choose(panes("twist.vx", "modules.module3.tilt"));
  sample();
  const modules = [...STATE.modules, { tilt: 9 }];
  say({ ...ROBOT, modules: ["module1", "module2", "module3"] });
  sample({ modules });
  expect(values("twist.vx")).toEqual([0.1, 0.1]);
  expect(values("modules.module3.tilt")).toEqual([NaN, 9]);
  say({ ...ROBOT, id: "other" });
  expect(recorder.buffer.length).toBe(0);
  expect(recorder.names).not.toEqual(["twist.vx", "modules.module3.tilt"]);
  say(ROBOT);
  expect(recorder.names).toEqual(["twist.vx", "modules.module3.tilt"]);
});

test("Plots start again when the robot's clock does.", () => {
  const { recorder, sample } = record();
  sample({ robot_s: 100 });
  sample({ robot_s: 3 });
  expect([...recorder.buffer.times]).toEqual([3]);
});

test("A field that was null is recorded from its first value on, and stays if null again.", () => {
  const { recorder, sample, pass, values } = record();
  recorder.choose(panes("truth.x"));
  sample();
  expect(recorder.fields).toEqual([]);
  pass(1000);
  sample({ truth: [7, 8, 9] });
  sample();
  expect(recorder.fields.map(({ name }) => name)).toEqual(["truth.x"]);
  expect(values("truth.x")).toEqual([NaN, 7, NaN]);
});

test("Fields that are not in every state are requested until they arrive.", () => {
  const { recorder, sample, pass, take, values } = record();
  const asked = () => take("plot_fields").map(({ names }) => names);
  recorder.choose(panes("twist.vx"));
  sample();
  expect(asked()).toEqual([]);
  recorder.choose(panes("twist.vx", "requested.vx_mps"));
  sample();
  sample();
  expect(asked()).toEqual([["requested.vx_mps"]]);
  pass(1000);
  sample();
  expect(asked()).toEqual([["requested.vx_mps"]]);
  sample({ plot: { "requested.vx_mps": 0.7 } });
  pass(1000);
  sample({ plot: { "requested.vx_mps": 0.8 } });
  expect(asked()).toEqual([]);
  expect(values("requested.vx_mps")).toEqual([NaN, NaN, NaN, NaN, 0.7, 0.8]);
  recorder.choose(panes("twist.vx"));
  sample({ plot: { "requested.vx_mps": 0.8 } });
  expect(asked()).toEqual([[]]);
});

test("At most sixteen fields are plotted.", () => {
  const { recorder } = record();
  recorder.choose(panes(...Array.from({ length: 40 }, (_, i) => `field${i}`)));
  expect(recorder.names).toHaveLength(MAX_FIELDS);
});

test("Layout and window are kept in the browser by robot, and unreadable ones are left out.", () => {
  const chosen = { windowS: 120, panes: [["twist.vx"], ["pose.x", "pose.y"]] };
  record().recorder.choose(chosen);
  const again = record().recorder;
  expect(again.layout.value).toEqual(chosen);
  again.choose(null);
  expect(again.names).toContain("link.round_trip_ms");
  for (const text of [
    "",
    "null",
    "7",
    "{",
    '{"tsd":3}',
    '{"tsd":"0:twist.vx"}',
    '{"tsd":"1e9:"}',
  ]) {
    localStorage.setItem("tsd-plots", text);
    expect(record().recorder.layout.value.windowS, text).toBe(20);
    expect(record().recorder.names, text).toContain("twist.vx");
  }
});

test("A link shows its plots once, and does not replace the kept ones until they change.", () => {
  record().recorder.choose(panes("pose.x"));
  history.replaceState(null, "", `?plots=${encodeURIComponent("60:twist.vx;odd%2Cname")}`);
  const { recorder } = record();
  expect(recorder.layout.value).toEqual({ windowS: 60, panes: [["twist.vx"], ["odd,name"]] });
  history.replaceState(null, "", "?");
  expect(record().recorder.names).toEqual(["pose.x"]);
});

test("Without states, the time axis stops.", () => {
  const { recorder, sample, pass } = record();
  sample();
  pass(100);
  expect(recorder.nowS()).toBeCloseTo(0.15);
  pass(5000);
  const stoppedS = recorder.nowS();
  pass(5000);
  expect(recorder.nowS()).toBe(stoppedS);
});

test("In a recording the axis ends at the cursor, jumps replace the past, and clicks seek.", () => {
  const { recorder, link, say, sample, take, pass } = record("drive.mcap");
  const view = new PlotView(recorder, link);
  say({ t: "cursor", t_s: 12, playing: false, speed: 1 });
  sample({ robot_s: 500 });
  pass(200);
  expect(view.span()).toEqual([480, 500]);
  expect(view.timeText(490)).toBe("2 s");
  view.seek(495);
  expect(take("seek")).toEqual([{ t: "seek", t_s: 7 }]);
  say({ t: "cursor", t_s: 7, playing: false, speed: 1 });
  const past = [493, 494].map((robot_s) => ({ ...STATE, robot_s }));
  say({ t: "past", states: past });
  sample({ robot_s: 495 });
  expect([...recorder.buffer.times]).toEqual([493, 494, 495]);
  expect(view.timeText(495)).toBe("7 s");
  const live = record();
  new PlotView(live.recorder, live.link).seek(1);
  expect(live.take("seek")).toEqual([]);
});
