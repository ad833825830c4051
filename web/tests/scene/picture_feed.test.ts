import { beforeEach, expect, test, vi } from "vitest";
import type { CameraEntry } from "../../src/generated/wire";
import { GIVE_UP_MS } from "../../src/scene/picture_decoder";
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
  vi.stubGlobal("requestAnimationFrame", (paint: () => void) => setTimeout(paint, 0));
});

/** A page that is shown the pictures, and a robot that says that it is ready. */
async function watched() {
  const page = openPage();
  const { pictures } = page.session;
  pictures.open.value = true;
  const context = { transferFromImageBitmap: (bitmap: ImageBitmap) => drawn.push(bitmap) };
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
  const picture = async (number: number, age_ms = 0, socket = pictureSocket(), coding = 0) => {
    const data = new DataView(new ArrayBuffer(29));
    data.setFloat64(0, age_ms, true);
    data.setFloat64(8, performance.now(), true);
    data.setUint32(16, number, true);
    data.setUint32(24, coding, true);
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

/** H.264: each picture depends on those before on its socket, from the latest key frame on. */
const [H264, H264_KEY] = [1, 2];
type Output = (frame: object) => void;
const closed: number[] = [];

/** A decoder of the browser; `decode` says when it outputs the frame of a chunk. */
function stubDecoder(decode: (output: Output, error: () => void, chunk: object) => void) {
  closed.length = 0;
  class FakeDecoder {
    static readonly isConfigSupported = async () => ({ supported: true });
    state = "unconfigured";
    constructor(readonly ends: { output: Output; error: () => void }) {}
    configure() {
      this.state = "configured";
    }
    decode({ timestamp }: { timestamp: number }) {
      if (this.state === "unconfigured") throw new Error("a key frame is missing");
      const frame = { timestamp, close: () => closed.push(timestamp) };
      decode(this.ends.output, this.ends.error, frame);
    }
    close() {
      this.state = "closed";
    }
  }
  vi.stubGlobal("VideoDecoder", FakeDecoder);
  vi.stubGlobal(
    "EncodedVideoChunk",
    class {
      constructor(chunk: object) {
        Object.assign(this, chunk);
      }
    },
  );
}

const asked = (socket: FakeSocket) => socket.sent.splice(0).map(({ h264 }) => h264);

test("a page without a decoder does not ask for H.264", async () => {
  const { picture } = await watched();
  await picture(1);
  expect(new Set(asked(pictureSocket()))).toEqual(new Set([false]));
});

test("a page that draws in software asks for JPEG", async () => {
  const { session, picture } = await watched();
  const socket = pictureSocket();
  asked(socket);
  session.pictures.software = true;
  await picture(1, 0, socket);
  expect(asked(socket)).toEqual([false]);
});

test("a page asks for a picture per frame", async () => {
  const { picture } = await watched();
  const socket = pictureSocket();
  socket.sent.splice(0);
  const frames: (() => void)[] = [];
  vi.stubGlobal("requestAnimationFrame", (paint: () => void) => frames.push(paint));
  await picture(1);
  await picture(2);
  for (const sent of [0, 1, 2]) {
    expect(socket.sent).toHaveLength(sent);
    frames.shift()?.();
  }
  expect(frames).toHaveLength(0);
});

test("a picture by H.264 is drawn with its age, and its frame is closed", async () => {
  stubDecoder((output, _, frame) => output(frame));
  const { picture, pictures } = await watched();
  const socket = pictureSocket();
  await picture(1, 40, socket, H264_KEY);
  await picture(2, 50, socket, H264);
  expect(drawn).toHaveLength(2);
  expect(closed).toEqual([1, 2]);
  expect(pictures.ageMs()).toBeCloseTo(50);
  expect(asked(socket).slice(-2)).toEqual([true, true]);
});

test.each([
  ["fails", (_: Output, error: () => void) => error()],
  ["holds pictures back", () => {}],
  [
    "is lost",
    () => {
      throw new Error("closed");
    },
  ],
  ["outputs another frame", (output: Output) => output({ timestamp: 0, close() {} })],
])("after a decoder that %s the page asks for JPEG, and the picture ages", async (_, decode) => {
  stubDecoder(decode);
  const { picture, pictures, wait } = await watched();
  const socket = pictureSocket();
  await picture(1);
  await picture(2, 0, socket, H264_KEY);
  await wait(GIVE_UP_MS + PERIOD_MS);
  expect(drawn).toHaveLength(1);
  expect(pictures.ageMs()).toBeGreaterThan(OLD_MS);
  expect(asked(socket).slice(-2)).toEqual([true, false]);
  await picture(3, 0, socket);
  expect(drawn).toHaveLength(2);
  expect(asked(socket)).toEqual([false]);
});

test("a picture that waits for its decoder while the camera is changed is no failure", async () => {
  stubDecoder(() => {});
  const { picture, pictures, wait } = await watched();
  await picture(1, 0, pictureSocket(), H264_KEY);
  pictures.choose(ABOVE.key);
  await wait(GIVE_UP_MS + PERIOD_MS);
  const socket = pictureSocket();
  socket.onopen();
  expect(asked(socket)).toEqual([true]);
});
