import { beforeEach, expect, test, vi } from "vitest";
import type { CameraEntry } from "../../src/generated/wire";
import { caution, LATE_MS, OLD_MS } from "../../src/scene/picture_feed";
import { FakeSocket } from "../support/fake_socket";
import { fakeBrowser, openPage } from "../support/page";

const AHEAD: CameraEntry = { key: "tsd/ahead", name: "ahead", robot: "tsd" };
const ABOVE: CameraEntry = { key: "floor/above", name: "above", robot: null };
const OTHER: CameraEntry = { key: "atlas/ahead", name: "ahead", robot: "atlas" };
const PERIOD_MS = 50;

let cameras: CameraEntry[] = [];
let drawn: ImageBitmap[] = [];

beforeEach(() => {
  fakeBrowser();
  cameras = [ABOVE, OTHER, AHEAD];
  drawn = [];
  vi.stubGlobal("fetch", async () => Response.json(cameras));
  vi.stubGlobal("createImageBitmap", async () => ({ width: 4, height: 3, close() {} }));
});

/** A page that is shown the pictures, and a robot that says that it is ready. */
async function watched() {
  const page = openPage();
  const { pictures } = page.session;
  pictures.open.value = true;
  const context = { drawImage: (bitmap: ImageBitmap) => drawn.push(bitmap) };
  const hide = pictures.drawOn({ getContext: () => context } as unknown as HTMLCanvasElement);
  const settle = () => vi.advanceTimersByTimeAsync(0);
  await settle();
  const stick = { held: false, share: { x: 1, y: 0, turn: 0 }, cancel: () => (stick.held = false) };
  page.drive.add(stick);
  const push = () => {
    stick.held = true;
    page.drive.changed();
  };
  /** Let time pass with states of a ready robot, and without pictures. */
  const wait = async (ms: number) => {
    for (let i = 0; i < ms; i += PERIOD_MS) {
      page.pass(PERIOD_MS, {});
      await settle();
    }
  };
  /** Deliver a picture of a given age to a socket. */
  const picture = async (number: number, age_ms = 0, socket = pictureSocket()) => {
    const data = new DataView(new ArrayBuffer(25));
    data.setFloat64(0, age_ms, true);
    data.setFloat64(8, performance.now(), true);
    data.setUint32(16, number, true);
    (socket.onmessage as (event: { data: unknown }) => void)({ data: data.buffer });
    await settle();
  };
  const lose = async (...left: CameraEntry[]) => {
    cameras = left;
    page.say({ t: "cameras_changed" });
    await settle();
  };
  return { ...page, pictures, hide, settle, push, stick, wait, picture, lose };
}

/** The latest WebSocket for pictures; the first WebSocket of a page carries messages. */
function pictureSocket(): FakeSocket {
  expect(FakeSocket.newest.address.pathname).toMatch(/pictures$/);
  return FakeSocket.newest;
}

test("the camera of the robot comes first, then one above the floor, and never another robot's", async () => {
  const { pictures, lose } = await watched();
  expect(pictures.camera.value).toEqual(AHEAD);
  pictures.choose(ABOVE.key);
  expect(pictures.camera.value).toEqual(ABOVE);
  await lose(OTHER);
  expect(pictures.camera.value).toBeNull();
});

test("speed falls from late pictures to old ones, and is zero for all that are older", () => {
  let before = 1;
  for (let ageMs = 0; ageMs < 3000; ageMs += 50) {
    const now = caution(ageMs);
    expect(now).toBeLessThanOrEqual(before);
    if (ageMs <= LATE_MS) expect(now).toBe(1);
    if (ageMs >= OLD_MS) expect(now).toBe(0);
    before = now;
  }
});

test("a robot that is driven by a late picture is asked for less speed", async () => {
  const { pictures, picture, push, take, wait } = await watched();
  pictures.main.value = true;
  await picture(1);
  push();
  expect(take("drive").at(-1)).toMatchObject({ vx: 2 });
  await wait(100);
  await picture(2, (LATE_MS + OLD_MS) / 2);
  await wait(2 * PERIOD_MS);
  const { vx } = take("drive").at(-1) as unknown as { vx: number };
  expect(vx).toBeLessThan(1.1);
  expect(vx).toBeGreaterThan(0.5);
});

test("driving by a picture ends when it is old, and not before the control is taken again", async () => {
  const { pictures, picture, push, take, wait, stick } = await watched();
  pictures.main.value = true;
  await picture(1);
  push();
  take();
  await wait(OLD_MS + 200);
  expect(take("release")).toHaveLength(1);
  expect(stick.held).toBe(false);
  push();
  expect(take("drive")).toEqual([]);
  await picture(2);
  await wait(PERIOD_MS * 4);
  expect(take("drive")).toEqual([]);
  push();
  expect(take("drive")).toHaveLength(1);
});

test("beside the scene an old picture hinders nobody", async () => {
  const { picture, push, take, wait } = await watched();
  await picture(1);
  await wait(OLD_MS + 200);
  push();
  expect(take("drive").at(-1)).toMatchObject({ vx: 2 });
});

test("a camera that is lost while it is driven by leaves its old picture, not another view", async () => {
  const { pictures, picture, push, take, wait, lose } = await watched();
  pictures.main.value = true;
  await picture(1);
  push();
  await lose(ABOVE);
  expect(pictures.camera.value).toEqual(AHEAD);
  await wait(OLD_MS + 200);
  expect(take("release")).toHaveLength(1);
  push();
  expect(take("drive")).toEqual([]);
  pictures.main.value = false;
  expect(pictures.camera.value).toEqual(ABOVE);
});

test("another robot is not shown by the camera of the first", async () => {
  const { pictures, say, settle } = await watched();
  const { ROBOT } = await import("../support/messages");
  pictures.main.value = true;
  say({ ...ROBOT, id: "atlas" });
  await settle();
  expect(pictures.main.value).toBe(false);
  expect(pictures.camera.value).toEqual(OTHER);
});

test("a picture that comes after a newer one is not drawn, and its socket is asked again", async () => {
  const { picture } = await watched();
  const socket = pictureSocket();
  socket.sent.splice(0);
  await picture(2);
  await picture(1);
  expect(drawn).toHaveLength(1);
  expect(socket.sent).toHaveLength(2);
});

test("a picture that is none is passed over", async () => {
  const { picture, pictures } = await watched();
  vi.stubGlobal("createImageBitmap", async () => Promise.reject(new Error("no picture")));
  await picture(1);
  expect(drawn).toHaveLength(0);
  expect(pictures.isShown).toBe(false);
});

test("a picture that arrives before the pane has a canvas counts as not shown", async () => {
  const { picture, pictures, hide } = await watched();
  hide();
  await picture(1);
  expect(pictures.isShown).toBe(false);
});

test.each([
  [1, 1],
  [3, 2],
])(
  "with %i pictures for each that arrives the page opens %i sockets in 3 s",
  async (step, most) => {
    const { picture, wait } = await watched();
    const sockets = new Set<FakeSocket>();
    for (let i = 1; i <= 60; i += 1) {
      sockets.add(pictureSocket());
      await picture(i * step);
      await wait(PERIOD_MS);
    }
    expect(sockets.size).toBe(most);
  },
);
