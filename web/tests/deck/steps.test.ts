import { beforeEach, expect, test, vi } from "vitest";
import { stepOf } from "../../src/deck/steps";
import type { RouteState } from "../../src/generated/wire";
import { fakeBrowser, LEASE, openPage } from "../support/page";

beforeEach(fakeBrowser);

const FREE = { ...LEASE, holder: null };
const BOBS = { ...LEASE, holder: "bob" };
const OTHERS = { has_control: false };
const STOPPED_BY = (by: string) => ({
  mode: "stopped",
  stop: { code: "stop_requested", params: { by } },
});

/** State of the robot, then the state of the slot, its sentence and its filled button. */
const TABLE: [string, object, object, string, string | undefined, string | undefined][] = [
  [
    "is free",
    { mode: "disarmed", lease: FREE },
    OTHERS,
    "free",
    "Control is free.",
    "Take control",
  ],
  [
    "is kept for you",
    { mode: "disarmed", lease: { ...FREE, reserved_for: "ann" } },
    OTHERS,
    "free",
    "Control is kept for you.",
    "Take control",
  ],
  ["is yours", { mode: "disarmed" }, {}, "disarmed", "You have control.", "Arm"],
  [
    "is arming",
    { mode: "arming", arming: { phase: "spin_up", progress: 0.4 } },
    {},
    "arming",
    "Spinning the wheels up",
    undefined,
  ],
  ["is ready", {}, {}, "speed", undefined, undefined],
  ["drives", { mode: "driving" }, {}, "speed", undefined, undefined],
  ["comes to rest", { mode: "stopping" }, {}, "speed", undefined, undefined],
  ["was stopped", STOPPED_BY("ann"), {}, "stopped", "You pressed STOP", "Hold to reset"],
  ["was stopped by another", STOPPED_BY("bob"), {}, "stopped", "Bob pressed STOP", "Hold to reset"],
  [
    "has a fault",
    { mode: "fault", stop: { code: "joints_silent", params: { ms: 80 } } },
    {},
    "fault",
    "The joints have not been measured for 80 ms,",
    "Hold to reset",
  ],
  [
    "was stopped with a reason",
    { mode: "stopped", stop: { code: "stop_with_text", params: { by: "bob", text: "smoke" } } },
    {},
    "stopped",
    "Smoke,",
    "Hold to reset",
  ],
  [
    "was stopped for a reason that is not known",
    { mode: "stopped", stop: null },
    {},
    "stopped",
    "Stopped",
    "Hold to reset",
  ],
  [
    "was stopped, and nobody has control",
    { ...STOPPED_BY("ann"), lease: FREE },
    OTHERS,
    "stopped",
    "You pressed STOP",
    "Take control",
  ],
  [
    "was stopped, and another has control",
    { ...STOPPED_BY("ann"), lease: BOBS },
    OTHERS,
    "stopped",
    "You pressed STOP",
    "Ask for control",
  ],
  [
    "is driven by another",
    { mode: "driving", lease: BOBS },
    { ...OTHERS, twist: [0.3, 0.4, 1] },
    "other",
    "Bob drives at 0.50 m/s.",
    "Ask for control",
  ],
  [
    "is another's, at rest",
    { mode: "ready", lease: BOBS },
    OTHERS,
    "other",
    "Bob has control.",
    "Ask for control",
  ],
  [
    "is asked for by you",
    { lease: { ...BOBS, requested_by: "ann", request_expires_in_s: 7.2 } },
    OTHERS,
    "waiting",
    "You asked Bob for control.",
    undefined,
  ],
  [
    "is asked for by another",
    { mode: "driving", lease: { ...LEASE, requested_by: "bob", request_expires_in_s: 7.2 } },
    {},
    "asked",
    "Bob asks for control.",
    "Hand over",
  ],
  [
    "is a replay",
    {},
    { source: "recording" },
    "replay",
    "This is a replay of a recording: it cannot be driven.",
    undefined,
  ],
];

test.each(TABLE)("a robot that %s", (_, status, fields, id, title, next) => {
  const { session, state } = openPage();
  state(status, fields);
  const step = stepOf(session);
  expect([step.id, step.title, step.next?.text]).toEqual([id, title, next]);
});

test("why the next step is refused is the robot's reason", () => {
  const { session, state } = openPage();
  const reason = { code: "at_rest_only" };
  for (const [request, mode] of [
    ["arm", "disarmed"],
    ["reset", "stopped"],
  ] as const) {
    state({ mode, refusals: { why: { [request]: reason } } });
    expect(stepOf(session).next?.refused).toEqual({ by: "robot", reason });
  }
  state({ lease: { ...BOBS, requested_by: "eva" } }, OTHERS);
  expect(stepOf(session).next?.refused).toMatchObject({ reason: { code: "other_request" } });
});

test("a viewer sees who drives and has no next step", () => {
  const { session, say, state, welcome } = openPage();
  say({ ...welcome, role: "viewer" });
  state({ mode: "driving", lease: BOBS }, OTHERS);
  const step = stepOf(session);
  expect([step.id, step.title, step.detail, step.next]).toEqual([
    "viewer",
    "Bob drives at 0.00 m/s.",
    "You may look, not drive.",
    undefined,
  ]);
});

test("without a link, seconds are counted and nothing is known of the robot", () => {
  const { session, socket, pass } = openPage();
  pass(2500);
  expect(stepOf(session)).toMatchObject({
    id: "silent",
    title: "No signal from the robot for 2 s.",
  });
  socket.readyState = 3;
  socket.onclose();
  pass(400);
  expect(stepOf(session)).toMatchObject({ id: "offline", title: "No connection for 0 s." });
});

test("a page of a recording that does not exist says so instead of connecting for ever", async () => {
  vi.stubGlobal("fetch", async () => ({ status: 404 }));
  history.replaceState(null, "", "?recording=run.mcap");
  const { session, socket, pass } = openPage();
  history.replaceState(null, "", "?");
  socket.readyState = 3;
  socket.onclose();
  pass(2500);
  await vi.advanceTimersByTimeAsync(0);
  expect(stepOf(session)).toMatchObject({
    id: "missing",
    title: "This recording no longer exists.",
    next: { text: "Back to live" },
  });
  vi.stubGlobal("fetch", () => Promise.reject(new Error("the dashboard has ended")));
  pass(2500);
  await vi.advanceTimersByTimeAsync(0);
  expect(stepOf(session).id).toBe("offline");
});

test("a stop that nobody confirms comes before all else, and can be acknowledged", () => {
  const { session, pass } = openPage();
  session.stop.press();
  pass(700, {});
  const { id, quiet } = stepOf(session);
  expect(id).toBe("unconfirmed");
  (quiet?.does as () => void)();
  expect(stepOf(session).id).toBe("speed");
});

test("a planned path is the next step until it is driven by hand, and a held one outlasts a request", () => {
  const { session, state } = openPage();
  const route = { number: 1, phase: "planned", length_m: 3, time_s: 8, done_m: 0 } as RouteState;
  state({}, { route });
  expect(stepOf(session)).toMatchObject({ id: "path", path: true });
  session.path.hold();
  const asked = { mode: "driving", lease: { ...LEASE, requested_by: "bob" } };
  state(asked, { route: { ...route, phase: "going", done_m: 1.5 } });
  expect(stepOf(session)).toMatchObject({ id: "going", progress: 0.5 });
  session.path.letGo();
  expect(stepOf(session).id).toBe("asked");
  state({ mode: "disarmed" }, { route });
  expect(stepOf(session).id).toBe("disarmed");
});

test("who waits for an answer can withdraw the request", () => {
  const { session, state } = openPage();
  state({ lease: { ...BOBS, requested_by: "ann", request_expires_in_s: 9 } }, OTHERS);
  const { detail, quiet } = stepOf(session);
  expect([detail, quiet?.does]).toEqual([
    "9 s left for the answer.",
    { t: "lease", op: "withdraw" },
  ]);
});

test("a recording tells the time looked at and what the robot itself does, and leads back", () => {
  vi.stubGlobal("fetch", () => Promise.reject(new Error("no lanes")));
  history.replaceState(null, "", "?recording=run.mcap");
  const { session, say, take } = openPage();
  history.replaceState(null, "", location.pathname);
  expect(stepOf(session)).toMatchObject({ id: "past", title: "", next: { text: "Back to live" } });
  const start = new Date(2026, 10, 20, 19, 18, 0).getTime();
  say({ t: "timeline", name: "run.mcap", start_ms: start, duration_s: 60, events: [] });
  say({ t: "cursor", t_s: 16, playing: false, speed: 1 });
  const robot = { id: "tsd", source: "robot", mode: "driving", driver: "bob", silent: false };
  const row = { ...robot, operators: { bob: "Bob" }, event: null, age_s: 0, latched: false };
  say({ t: "fleet", whole: true, robots: [row], poses: {} });
  expect(stepOf(session)).toMatchObject({
    title: "You look at 19:18:16.",
    detail: expect.stringMatching(/now .*driving.*, and Bob drives\.$/i),
  });
  expect(take("drive")).toEqual([]);
});
