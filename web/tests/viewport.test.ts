import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Viewport, viewportAddress } from "../src/viewport/frame.ts";
import type { FrameKey, FromFrame } from "../src/viewport/messages.ts";

const keys: FrameKey[] = [];

beforeEach(() => {
  vi.useFakeTimers();
  keys.length = 0;
  document.head.innerHTML = '<meta name="tsd-viewport" content="8090">';
});

afterEach(() => {
  vi.useRealTimers();
  document.body.innerHTML = "";
});

function open(isComplete = () => true) {
  const options = { page: "0123456789abcdef", recording: null, dark: true, title: "3D view" };
  const onKey = (key: FrameKey) => void keys.push(key);
  const hooks = { onKey, onPointer: () => {}, isComplete };
  const viewport = new Viewport(document.body, { ...options, ...hooks });
  const frame = document.querySelector("iframe")!;
  const hear = (
    data: FromFrame,
    origin = new URL(frame.src).origin,
    source = frame.contentWindow,
  ) => dispatchEvent(new MessageEvent("message", { data, origin, source }));
  return { viewport, frame, hear };
}

function press(down = true, repeat = false): FrameKey {
  const mods = { ctrl: false, alt: false, shift: false, meta: false };
  return { tsd: 1, t: "key", code: "Space", key: " ", down, repeat, mods };
}

test("The view has the page's address with another port, or at another origin.", () => {
  const base = "http://127.0.0.1:8080/twin/";
  expect(viewportAddress(base, "8090").href).toBe("http://127.0.0.1:8090/twin/viewport/");
  expect(viewportAddress(base, "").href).toBe("http://127.0.0.1:8080/twin/viewport/");
  const other = viewportAddress(base, "https://robot.example:8443");
  expect(other.href).toBe("https://robot.example:8443/twin/viewport/");
  expect(viewportAddress("https://a.example:8080/", "https://a.example").port).toBe("");
});

test("The view is told its size, which it does not know when it starts.", () => {
  vi.spyOn(document.body, "clientWidth", "get").mockReturnValue(1000);
  vi.spyOn(document.body, "clientHeight", "get").mockReturnValue(640);
  expect(new URL(open().frame.src).searchParams.get("pixels")).toBe("640000");
  vi.restoreAllMocks();
});

test("If the second port stays silent, the view comes from the page's origin.", () => {
  const { frame } = open();
  vi.advanceTimersByTime(4_900);
  expect(new URL(frame.src).port).toBe("8090");
  vi.advanceTimersByTime(200);
  expect(new URL(frame.src).origin).toBe(location.origin);
});

test("If the second port answers in time, the view stays there.", () => {
  const { frame, hear } = open();
  hear({ tsd: 1, t: "loaded", software: false });
  vi.advanceTimersByTime(60_000);
  expect(new URL(frame.src).port).toBe("8090");
});

test("The view is shown once all of the scene has been drawn.", () => {
  let isComplete = false;
  const { viewport, hear } = open(() => isComplete);
  const draw = (frames: number) => {
    for (let i = 0; i < frames; i += 1) hear({ tsd: 1, t: "drawn" });
  };
  draw(10);
  isComplete = true;
  draw(10);
  expect(viewport.ready.value).toBe(false);
  vi.advanceTimersByTime(250);
  draw(1);
  expect(viewport.ready.value).toBe(true);
});

test("Messages of other origins and windows are ignored.", () => {
  const { viewport, frame, hear } = open();
  hear({ tsd: 1, t: "loaded", software: false }, "http://evil.example");
  hear({ tsd: 1, t: "loaded", software: false }, new URL(frame.src).origin, window);
  expect(viewport.loaded.value).toBe(false);
});

test("Keys count once, and only while the frame has the focus, which the page takes back.", () => {
  const { frame, hear } = open();
  hear(press());
  expect(keys).toEqual([]);
  frame.focus();
  hear(press(true, true));
  hear(press(false));
  expect(keys).toEqual([]);
  hear(press());
  hear(press());
  expect(keys.map(({ code }) => code)).toEqual(["Space"]);
  expect(document.activeElement).not.toBe(frame);
});

test("Less sharpness is a smaller frame, enlarged.", () => {
  const { viewport, frame } = open();
  viewport.setSharpness(0.5);
  expect([frame.style.width, frame.style.transform]).toEqual(["50%", "scale(2)"]);
  viewport.dispose();
  expect(document.querySelector("iframe")).toBeNull();
});

test("A view that is paused before it can be reached pauses once it is.", () => {
  const { viewport, frame, hear } = open();
  const sent = vi.fn();
  vi.spyOn(frame, "contentWindow", "get").mockReturnValue({ postMessage: sent } as never);
  viewport.pause(true);
  expect(sent).not.toHaveBeenCalled();
  hear({ tsd: 1, t: "loaded", software: false });
  expect(sent.mock.calls.at(-1)?.[0]).toEqual({ tsd: 1, t: "pause", on: true });
});
