import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { LookBack } from "../../src/timeline/look_back";
import { addressOf } from "../../src/timeline/library";
import { eventFrom, Playback } from "../../src/timeline/playback";
import { shareAt } from "../../src/ui/slider";
import { openLink, WELCOME } from "./link";

const TIMELINE = { t: "timeline", name: "a.mcap", start_ms: 1_700_000_000_000, duration_s: 60 };
const at = (t_s: number) => ({ t_s, robot: "tsd", kind: "stop", text: "", count: 1, why: null });

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("fetch", () => Promise.reject(new Error("no server")));
  history.replaceState(null, "", "/next/");
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

/** Messages other than heartbeats. */
function messages(sent: { t: string }[]) {
  return sent.filter(({ t }) => t !== "heartbeat");
}

test("A look back ends with the return to live, and sends nothing that moves a robot", () => {
  const { link, sent } = openLink();
  const back = new LookBack(link);
  back.look(12.34);
  vi.advanceTimersByTime(60);
  back.look(99);
  vi.advanceTimersByTime(60);
  back.look(0);
  vi.advanceTimersByTime(1000);
  expect(messages(sent)).toEqual([
    { t: "look_back", history_offset_s: 12.3 },
    { t: "look_back", history_offset_s: 30 },
    { t: "look_back", history_offset_s: null },
  ]);
  expect(back.agoS.value).toBeNull();
});

test("While a pointer drags, the last time is sent, at most twenty times a second", () => {
  const { link, sent } = openLink();
  const back = new LookBack(link);
  for (let i = 0; i < 100; i++) {
    back.look(30 - i / 5);
    vi.advanceTimersByTime(5);
  }
  vi.advanceTimersByTime(100);
  expect(messages(sent).length).toBeLessThanOrEqual(12);
  expect(messages(sent).at(-1)).toEqual({ t: "look_back", history_offset_s: 10.2 });
});

test("A past state of an earlier request is not shown for a later one", () => {
  const { link, hear } = openLink();
  const back = new LookBack(link);
  const past = (history_offset_s: number) => ({
    history_offset_s,
    mode: "ready",
    pose: null,
    twist: null,
  });
  const state = (status_seq: number, offset: number) =>
    hear({ t: "state", status_seq, age_ms: 0, past: past(offset), status: { mode: "ready" } });
  back.look(5);
  back.look(7);
  state(1, 5);
  expect(back.past.value).toBeNull();
  state(2, 7);
  expect(back.past.value).toEqual(past(7));
});

test("Another robot is shown live, without the modes of the robot before", () => {
  const { link, hear } = openLink();
  const back = new LookBack(link);
  hear({ t: "state", status_seq: 1, age_ms: 0, past: null, status: { mode: "ready" } });
  back.look(5);
  expect(back.modes).toHaveLength(1);
  hear({ t: "robot", id: "kiwi" });
  expect([back.agoS.value, back.modes]).toEqual([null, []]);
});

test("Modes are kept for half a minute, with gaps where no state arrived", () => {
  const { link, hear } = openLink();
  const back = new LookBack(link);
  let seq = 0;
  const state = (mode: string) =>
    hear({ t: "state", status_seq: ++seq, age_ms: 0, past: null, status: { mode } });
  for (let i = 0; i < 20; i++) {
    state(i < 10 ? "ready" : "driving");
    vi.advanceTimersByTime(100);
  }
  expect(back.modes.map(({ mode }) => mode)).toEqual(["ready", "driving"]);
  vi.advanceTimersByTime(5000);
  state("driving");
  expect(back.modes).toHaveLength(3);
  expect(back.modes[2]!.fromMs - back.modes[1]!.toMs).toBeGreaterThan(4900);
  vi.advanceTimersByTime(31_000);
  state("ready");
  expect(back.modes.map(({ mode }) => mode)).toEqual(["ready"]);
});

test("A point of the lane is a share of it, also beside the lane and before it has a size", () => {
  expect([90, 100, 300, 500, 900].map((x) => shareAt(x, 100, 400))).toEqual([0, 0, 0.5, 1, 1]);
  expect(shareAt(5, 0, 0)).toBe(0);
});

test("Seeking stays within the recording", () => {
  const { link, sent, hear } = openLink("a.mcap");
  const playback = new Playback(link);
  hear({ ...TIMELINE, events: [] });
  hear({ t: "cursor", t_s: 3, playing: false, speed: 1 });
  for (const tS of [99, -7, 4]) {
    playback.seek(tS);
    vi.advanceTimersByTime(60);
  }
  expect(messages(sent)).toEqual([60, 0, 4].map((t_s) => ({ t: "seek", t_s })));
});

test("The time in the address is shown once the recording is open, and the address keeps it", () => {
  history.replaceState(null, "", addressOf("a b.mcap", 12.34));
  expect(location.search).toBe("?recording=a+b.mcap&t=12.3");
  const { link, sent, hear } = openLink("a b.mcap");
  new Playback(link);
  hear(WELCOME);
  expect(messages(sent)).toEqual([]);
  hear({ ...TIMELINE, events: [] });
  hear({ ...TIMELINE, events: [at(2)] }); // After a mark, for example.
  vi.advanceTimersByTime(100);
  expect(messages(sent)).toEqual([{ t: "seek", t_s: 12.3 }]);
});

test("After a new connection, the same time is shown", () => {
  const { link, sent, hear } = openLink("a.mcap");
  new Playback(link);
  hear(WELCOME);
  hear({ ...TIMELINE, events: [] });
  hear({ t: "cursor", t_s: 33, playing: false, speed: 1 });
  hear(WELCOME);
  hear({ ...TIMELINE, events: [] });
  expect(messages(sent)).toEqual([{ t: "seek", t_s: 33 }]);
});

test("Next and previous leave the event that is shown", () => {
  const events = [at(1), at(5), at(5.01), at(9)];
  expect(eventFrom(events, 1, 1)!.t_s).toBe(5);
  expect(eventFrom(events, 5, 1)!.t_s).toBe(9);
  expect(eventFrom(events, 5, -1)!.t_s).toBe(1);
  expect(eventFrom(events, 9, 1)).toBeUndefined();
  expect(eventFrom(events, 1, -1)).toBeUndefined();
});

test("A new speed counts at once while playing, and else from the next play on", () => {
  const { link, sent, hear } = openLink("a.mcap");
  const playback = new Playback(link);
  hear({ ...TIMELINE, events: [] });
  playback.setSpeed(4);
  expect(messages(sent)).toEqual([]);
  playback.toggle();
  hear({ t: "cursor", t_s: 1, playing: true, speed: 4 });
  playback.setSpeed(0.5);
  playback.toggle();
  expect(messages(sent)).toEqual([
    { t: "play", speed: 4 },
    { t: "play", speed: 0.5 },
    { t: "pause" },
  ]);
});
