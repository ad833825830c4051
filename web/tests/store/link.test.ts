import { beforeEach, expect, test, vi } from "vitest";
import { freshness } from "../../src/store/freshness";
import { Link } from "../../src/store/link";
import { whyNotTakeControl } from "../../src/store/permission";
import { FakeSocket } from "../support/fake_socket";
import { fakeBrowser, openPage } from "../support/page";

beforeEach(fakeBrowser);

/** Open a link to a dashboard that has not answered yet. */
function opening(name = "") {
  const link = new Link("1", null, name);
  link.open();
  const why = () => whyNotTakeControl(link);
  return { link, socket: FakeSocket.newest, why };
}

const nameSent = () => FakeSocket.newest.address.searchParams.get("name");
const page = (code: string) => ({ by: "page", code });

test("a listener hears the messages of its kind until it is ended", () => {
  const { link, say, state } = openPage();
  const heard: string[] = [];
  const end = link.on("state", ({ t }) => heard.push(t));
  link.on("reply", ({ t }) => heard.push(t));
  state();
  say({ t: "reply", to: "arm", ok: true, why: null });
  end();
  state();
  expect(heard).toEqual(["state", "reply"]);
});

test("a listener that another adds hears the next message, and one that another ends none", () => {
  const { link, state } = openPage();
  const heard: string[] = [];
  link.on("state", () => {
    if (heard.push("first") > 1) return;
    endOther();
    link.on("state", () => heard.push("added"));
  });
  const endOther = link.on("state", () => heard.push("ended"));
  state();
  expect(heard).toEqual(["first"]);
  state();
  expect(heard).toEqual(["first", "first", "added"]);
});

test("a typed name is sent at once, and again with the next connection", () => {
  const { link, socket } = opening();
  expect(nameSent()).toBeNull();
  socket.onopen();
  link.rename("");
  link.rename("Анна");
  expect(socket.take("name")).toEqual([{ t: "name", name: "Анна" }]);
  socket.onclose();
  vi.advanceTimersByTime(1000);
  expect(FakeSocket.newest).not.toBe(socket);
  expect(nameSent()).toBe("Анна");
});

test("a page that loads is connecting, and says so if that takes more than five seconds", () => {
  const { link, socket, why } = opening();
  vi.advanceTimersByTime(4900);
  expect([freshness(link).kind, why()]).toEqual(["starting", page("connecting")]);
  vi.advanceTimersByTime(200);
  expect([freshness(link).kind, why()]).toEqual(["offline", page("not_connected")]);
  socket.onopen();
  expect(why()).toEqual(page("no_robot"));
});

test("a connection that is lost before the first state is reported at once", () => {
  const { link, socket, why } = opening();
  vi.advanceTimersByTime(300);
  socket.onopen();
  expect(link.isLoading()).toBe(true);
  socket.onclose();
  expect([link.isLoading(), why()]).toEqual([false, page("not_connected")]);
});

test("a page that has stalled reads its messages before it takes the connection for lost", () => {
  const { link, socket } = openPage();
  const now = performance.now.bind(performance);
  let stalledMs = 0;
  vi.spyOn(performance, "now").mockImplementation(() => now() + stalledMs);
  socket.send = () => {}; // No echo any more.
  stalledMs = 30_000;
  vi.advanceTimersByTime(300);
  expect(link.connected.value).toBe(true);
  socket.say({ t: "heartbeat", sent_ms: performance.now() - 30_000 });
  vi.advanceTimersByTime(1800);
  expect(link.connected.value).toBe(true);
  vi.advanceTimersByTime(400); // Two seconds without an echo in which the page ran.
  expect([link.connected.value, socket.readyState]).toEqual([false, 3]);
  vi.restoreAllMocks();
});

test("an event has the time at which it happened, also one of an hour ago", () => {
  const { link, say } = openPage();
  const event = { t: "event", kind: "mode", text: "", why: { code: "released" }, past: true };
  say({ ...event, robot_s: 12.5, age_s: 3600 });
  say({ ...event, robot_s: 12.5, age_s: 0 });
  expect(link.history.value.map(({ atMs }) => Date.now() - atMs)).toEqual([3_600_000, 0]);
});

/** Open the lanes of a page that has control. */
function openLanes() {
  const page = openPage();
  vi.advanceTimersByTime(200);
  for (const lane of FakeSocket.lanes) lane.readyState = FakeSocket.OPEN;
  const sockets = [page.socket, ...FakeSocket.lanes];
  for (const socket of sockets) socket.take();
  const sent = (kind: string) => sockets.map((each) => each.sent.filter(({ t }) => t === kind));
  return { ...page, sockets, sent };
}

const drive = { t: "drive", vx: 1, vy: 0, omega: 0, status_seq: 1 } as const;

test("a page has lanes once it has control, and none after its connection has ended", () => {
  const { link } = opening();
  FakeSocket.newest.onopen();
  vi.advanceTimersByTime(1000);
  expect(FakeSocket.lanes).toHaveLength(0);
  const { socket, sockets } = openLanes();
  expect(FakeSocket.lanes.map(({ address }) => address.pathname)).toEqual(
    Array(3).fill("/teleop/lane"),
  );
  socket.onclose();
  expect(sockets.slice(1).map(({ readyState }) => readyState)).toEqual([3, 3, 3]);
  expect(link.connected.value).toBe(true);
});

test("commands take turns on the sockets that are not stalled, in numbered order", () => {
  const { link, sockets, sent } = openLanes();
  for (let i = 0; i < 8; i += 1) link.send(drive);
  expect(sent("drive").map((each) => each.length)).toEqual([2, 2, 2, 2]);
  const numbers = sent("drive")
    .flat()
    .map(({ number }) => Number(number));
  expect(Math.max(...numbers) - Math.min(...numbers)).toBe(7);
  expect(new Set(numbers).size).toBe(8);
  expect(
    sent("drive")
      .flat()
      .every(({ selection }) => selection === 1),
  ).toBe(true);
  for (const socket of sockets.slice(1)) socket.bufferedAmount = 2000;
  for (let i = 0; i < 8; i += 1) link.send(drive);
  expect(sent("drive").map((each) => each.length)).toEqual([10, 2, 2, 2]);
});

test("what can only stop the robot goes over all sockets, with one number", () => {
  const { link, sent } = openLanes();
  for (const t of ["release", "stop"] as const) {
    link.send({ t });
    const copies = sent(t);
    expect(copies.map((each) => each.length)).toEqual([1, 1, 1, 1]);
    expect(new Set(copies.flat().map(({ number }) => number)).size).toBe(1);
  }
  link.send({ t: "arm" });
  expect(sent("arm").map((each) => each.length)).toEqual([1, 0, 0, 0]);
});

test("of states over lanes, none is shown after a newer one or for another robot", () => {
  const { link, sockets, state } = openLanes();
  const lane = sockets[2]!;
  state();
  const shown = link.state.value!;
  lane.say({ ...shown, status_seq: 0, age_ms: 1 });
  lane.say({ ...shown, status_seq: shown.status_seq + 1, selection: 2, age_ms: 2 });
  expect(link.state.value).toBe(shown);
  lane.say({ ...shown, status_seq: shown.status_seq + 2, age_ms: 3 });
  expect(link.state.value?.age_ms).toBe(3);
  const lost = link.lost;
  lane.say({ ...shown, status_seq: shown.status_seq + 1, age_ms: 4 });
  expect(link.state.value?.age_ms).toBe(3);
  expect(link.lost).toBeLessThan(lost); // It was late, not lost.
});

test("a lane that is silent for two seconds is replaced", () => {
  const { state } = openLanes();
  const [first, second, third] = FakeSocket.lanes;
  first!.send = () => {}; // No echo any more.
  third!.readyState = 3;
  for (let i = 0; i < 25; i += 1) {
    state();
    vi.advanceTimersByTime(100);
  }
  expect([first, second, third].map((lane) => lane!.readyState)).toEqual([3, 1, 3]);
  expect(FakeSocket.lanes).toHaveLength(5);
});
