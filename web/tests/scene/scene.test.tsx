import { render } from "preact";
import { act } from "preact/test-utils";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Layer, RobotInfo, SphereState } from "../../src/generated/wire";
import { GoToForm } from "../../src/panel/drive_tab";
import { legend } from "../../src/scene/corners";
import { Scene } from "../../src/scene/scene";
import { draw } from "../support/draw";
import { openSession, press, ROBOT, route } from "./support";

const host = document.createElement("div");
document.body.append(host);

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setInterval", "clearInterval", "performance"] });
});

afterEach(() => {
  render(null, host);
  vi.useRealTimers();
});

async function show(robot?: RobotInfo) {
  const page = openSession(robot);
  const { session } = page;
  await act(() => draw([<Scene />, <GoToForm />], session, host));
  page.take();
  return page;
}

/** Render what has changed, and run effects. */
const settle = () => act(() => new Promise<void>((resolve) => setTimeout(resolve)));
const find = (selector: string) => host.querySelector<HTMLElement>(selector);
const radio = (text: string) =>
  [...host.querySelectorAll<HTMLElement>("[role=radio]")].find((node) => node.textContent === text);

test("Keys 1 to 3 choose a camera, which looks at the robot again, and N the map.", async () => {
  const { session, take } = await show();
  for (const [code, camera] of [
    ["Digit2", "top"],
    ["Numpad3", "chase"],
    ["Digit1", "3-D"],
  ] as const) {
    press(code);
    const views = take("view") as unknown as { settings: { camera: string }; look: boolean }[];
    expect(views.map(({ settings, look }) => [settings.camera, look])).toEqual([[camera, true]]);
  }
  const wasOpen = find(".inset") !== null;
  press("KeyN");
  await settle();
  expect(find(".inset") !== null).toBe(!wasOpen);
  expect(take("map")).toEqual([{ t: "map", on: !wasOpen }]);
  expect(session.drive.held.value).toBe(false);
});

test("Without control, a path cannot be chosen, and the reason is given.", async () => {
  const { session, state } = await show();
  state({ has_control: false });
  await settle();
  const choice = radio("Go to")!;
  expect(choice.getAttribute("aria-disabled")).toBe("true");
  expect(choice.title).not.toBe("");
  choice.click();
  expect(session.path.mode.value).toBe("stick");
});

test("The layer that takes clicks is there only while a place is chosen and nothing moves.", async () => {
  const { session, state } = await show();
  expect(find(".picks.on-picture")).toBeNull();
  radio("Go to")!.click();
  await settle();
  expect(find(".picks.on-picture")).not.toBeNull();
  state({ route: route("planned") });
  session.path.hold();
  await settle();
  expect(find(".picks.on-picture")).toBeNull();
  session.path.letGo();
});

test("A window that becomes narrow shows the scene, where the map would cover it.", async () => {
  const { session } = await show();
  const { narrow } = session.layout;
  for (const [isNarrow, pressed, expected] of [
    [false, false, true],
    [true, false, false],
    [true, true, true],
    [false, false, true],
    [true, true, false],
  ] as const) {
    narrow.value = isNarrow;
    if (pressed) press("KeyN");
    await settle();
    expect(find(".inset") !== null).toBe(expected);
  }
});

test("A sphere has neither map nor paths.", async () => {
  const { state } = await show({ ...ROBOT, id: "atlas", panel: "sphere", space: "sphere" });
  state({ sphere: { wxyz: [1, 0, 0, 0] } as unknown as SphereState });
  await settle();
  expect([find(".inset"), find(".map"), radio("Go to"), find("form")]).toEqual([
    null,
    null,
    undefined,
    null,
  ]);
});

test("Behind the page of all robots, the scene stays but is hidden.", async () => {
  const { session } = await show();
  const frame = find("iframe");
  session.layout.screen.value = "fleet";
  await settle();
  expect(find("main")!.classList.contains("covered")).toBe(true);
  expect(find("iframe")).toBe(frame);
});

test("Empty fields of the form keep the robot's place, and its heading.", async () => {
  const { take } = await show();
  const field = (name: string) => find(`form [name=${name}]`) as HTMLInputElement;
  const submit = () => {
    find("form")!.dispatchEvent(new Event("submit", { cancelable: true }));
    return take("plan").map(({ points, heading }) => ({ points, heading }));
  };
  field("x").value = "3.5";
  expect(submit()).toEqual([{ points: [[3.5, 2]], heading: null }]);
  field("heading").value = "90";
  const [plan] = submit();
  expect(plan!.heading).toBeCloseTo(Math.PI / 2);
});

test("The legend has only what the scene of a robot can show.", () => {
  const names = (robot: Partial<RobotInfo>, hidden: Layer[] = []) =>
    legend({ ...ROBOT, ...robot }, (layer) => !hidden.includes(layer), false, false).flatMap(
      (row) => row.name,
    );
  expect(names({})).toEqual(["push", "axle", "trail", "stopsWithin"]);
  expect(names({ modules: [], wheels: ["1"] })).toEqual(["push", "trail", "stopsWithin"]);
  expect(names({ space: "sphere", modules: [], wheels: ["1"] })).toEqual(["push"]);
  expect(names({}, ["trail", "stop_envelope", "thrust"])).toEqual(["axle"]);
});

test("The refusal of a path is a notice, until its cause is gone.", async () => {
  const { session, say, state } = await show();
  state({ has_control: false });
  session.path.plan({ kind: "to", on: "floor", points: [[0, 0]] });
  expect(session.notice.text.value).not.toBeNull();
  for (let i = 0; i < 25; i++) {
    vi.advanceTimersByTime(100);
    say({ t: "heartbeat", sent_ms: performance.now() });
    state({ has_control: false });
  }
  expect(session.notice.text.value).not.toBeNull();
  state({ has_control: true });
  vi.advanceTimersByTime(100);
  expect(session.notice.text.value).toBeNull();
});

test("An arrow at the rim points to a robot outside the picture, and brings it back.", async () => {
  const { state, take } = await show();
  const arrow = () => find(".rim-arrow");
  expect(arrow()).toBeNull();
  state({ camera: { off_screen_rad: Math.PI / 2 } });
  await settle();
  expect([arrow()!.style.left, arrow()!.style.top]).toEqual(["50.0%", "14.0%"]);
  arrow()!.click();
  expect(take("view")).toMatchObject([{ look: true }]);
  state({ camera: { off_screen_rad: null } });
  await settle();
  expect(arrow()).toBeNull();
});
