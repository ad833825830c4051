import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { fakeBrowser, fire, lift, press, ROBOT } from "../support/page";
import { openPanel } from "../support/panel";

beforeEach(fakeBrowser);
afterEach(() => void vi.useRealTimers());

const READY = {};

test("A slider drives while it is held, and springs to zero when it is let go.", () => {
  const { drag, pass, take, drive } = openPanel();
  const forward = drag("Forward", 0.5);
  pass(40, READY);
  expect(take("drive").at(-1)).toMatchObject({ vx: 1, vy: 0, omega: 0 });
  forward.letGo();
  expect(take("drive", "release").at(-1)).toEqual({ t: "release" });
  expect(drive.asked.value).toEqual({ x: 0, y: 0, turn: 0 });
  expect(forward.track.getAttribute("aria-valuetext")).toBe("zero");
});

test("Left and turning left lie on the left of their sliders.", () => {
  const { drag, drive } = openPanel();
  const left = drag("Left", -0.5);
  expect(drive.asked.value.y).toBeCloseTo(1);
  expect(left.track.getAttribute("aria-valuetext")).toBe("1.00 metres per second left");
  left.letGo();
  drag("Turn left", -0.25);
  expect(drive.asked.value.turn).toBeCloseTo(1);
});

test.each([
  ["loses its pointer", (track: HTMLElement) => fire(track, "pointercancel", { pointerId: 1 })],
  ["loses the window's focus", () => fire(null, "blur")],
  ["loses its page", () => fire(null, "pagehide")],
])("A slider that %s springs to zero, and the robot stops.", (_, lose) => {
  const { drag, pass, take, does, drive } = openPanel();
  const { track } = drag("Forward", 1);
  pass(40, READY);
  take();
  does(() => void lose(track));
  expect(drive.held.value).toBe(false);
  expect(take()).toEqual([{ t: "release" }]);
});

test("Arrow keys move a slider with the focus and spring back at key up.", () => {
  const { find, does, drive } = openPanel();
  const track = find("[aria-label=Left]");
  does(() => void press(track, "ArrowRight"));
  expect(drive.asked.value.y).toBe(-2);
  does(() => void lift(track, "ArrowRight"));
  expect(drive.held.value).toBe(false);
});

test("Only look moves nothing but the picture, and springs too.", () => {
  const { click, drag, pass, take, say, text, find } = openPanel();
  click("Only look");
  take();
  const forward = drag("Forward", 0.5);
  pass(200, READY);
  expect(take().every(({ t }) => t === "preview")).toBe(true);
  expect(find(".js").classList).toContain("looks");
  const module = {
    alpha: 1,
    beta: 2,
    tilt: 7,
    direction: 0,
    axle: [0, 0],
    push: [1, 0],
    rpm: 2400,
  };
  const reply = { t: "preview", robot: "tsd", requested: [1, 0, 0], twist: [1, 0, 0], joints: [] };
  say({ ...reply, utilization: 1.3, limit: "tilt", modules: [module, module, module], wheels: [] });
  expect(text(".sec.looks")).toContain("7.0°");
  expect(text(".sec.looks")).toContain("130 %");
  expect(text(".sec.looks")).toContain("The tilt limit holds the robot back.");
  forward.letGo();
  expect(take()).toEqual([{ t: "preview", twist: null }]);
  expect(find(".sec.looks")).toBeNull();
});

test("While a key drives, a slider that only looks adds nothing to the command.", () => {
  const { click, drag, pass, take, does } = openPanel();
  click("Only look");
  drag("Left", -1);
  does(() => void press(document.body, "KeyW"));
  pass(40, READY);
  expect(take("drive").at(-1)).toMatchObject({ vx: 2, vy: 0 });
  does(() => void lift(document.body, "KeyW"));
  expect(take("drive", "release", "preview").map(({ t }) => t)).toEqual(
    expect.arrayContaining(["release", "preview"]),
  );
});

test("A recording has no sliders, so that it is not driven and asks for no preview.", () => {
  history.replaceState(null, "", "?recording=run.mcap");
  const { box } = openPanel();
  history.replaceState(null, "", location.pathname);
  expect(box.textContent).toContain("What the wheels do");
  expect(box.querySelectorAll("[role=slider]")).toHaveLength(0);
});

test("Floor axes turn what is looked at into the robot's axes.", () => {
  const { click, drag, take, state, does, drive } = openPanel();
  state({}, { pose: [0, 0, Math.PI / 2] });
  does(() => drive.setFrame("odom"));
  click("Only look");
  take();
  drag("Along x of the floor", 0.5);
  const [vx, vy] = take("preview").at(-1)!["twist"] as number[];
  expect(vx).toBeCloseTo(0);
  expect(vy).toBeCloseTo(-1);
});

function keeping() {
  const panel = openPanel();
  panel.click("More about the sliders");
  panel.click("Keep value");
  panel.drag("Forward", 0.5).letGo();
  panel.pass(40, READY);
  return panel;
}

test("A kept value drives on with no hand on it, and another slider joins it.", () => {
  const { take, drive, drag, pass } = keeping();
  expect(drive.alone.value).toBe(true);
  expect(take("drive").at(-1)).toMatchObject({ vx: 1 });
  drag("Turn left", -0.25);
  pass(40, READY);
  const { vx, omega } = take("drive").at(-1)!;
  expect([vx, omega]).toEqual([1, expect.closeTo(1)]);
});

test.each([
  ["a key that drives", () => press(document.body, "KeyA")],
  ["STOP", () => press(document.body, "Space")],
  ["loss of the window's focus", () => fire(null, "blur")],
  ["Home on a slider", () => press(document.querySelector("[role=slider]"), "Home")],
])("A kept value is ended by %s, and Keep value with it.", (_, input) => {
  const { does, drive, text, pass } = keeping();
  does(() => void input());
  pass(20, READY);
  expect(drive.alone.value).toBe(false);
  expect(drive.asked.value.x).toBe(0);
  expect(text("[role=status]")).toContain("it springs to zero");
});

test("A kept value ends with the tab.", () => {
  const { click, take, drive } = keeping();
  take();
  click("View");
  expect(drive.held.value).toBe(false);
  expect(take()).toContainEqual({ t: "release" });
});

test("A lost pointer keeps no value.", () => {
  const { click, drag, drive } = openPanel();
  click("More about the sliders");
  click("Keep value");
  drag("Forward", 0.5).lose();
  expect(drive.held.value).toBe(false);
});

test("Only look keeps no value.", () => {
  const { drive, click } = keeping();
  click("Only look");
  expect(drive.held.value).toBe(false);
  click("More about the sliders");
  click("Keep value");
  expect(drive.held.value).toBe(false);
});

test("A sphere rolls ahead about its Y axis, and left about minus X.", () => {
  const { say, drag, pass, take, state } = openPanel();
  const axes = ["ωx", "ωy", "ωz"].map((symbol) => ({ name: symbol, symbol, unit: "rad/s" }));
  const sphere = { panel: "sphere", space: "sphere", modules: [] };
  say({ ...ROBOT, ...sphere, id: "atlas", title: "Atlas", twist_axes: axes });
  state();
  const forward = drag("Roll forward", 0.5);
  pass(40, READY);
  expect(take("drive").at(-1)).toMatchObject({ vx: expect.closeTo(0), vy: 1, omega: 0 });
  forward.letGo();
  drag("Roll left", -0.5);
  pass(40, READY);
  expect(take("drive").at(-1)).toMatchObject({ vx: -1, vy: 0, omega: 0 });
});

test.each([
  ["Only look", "Drive"],
  ["Drive", "Only look"],
])("From %s to %s, a held slider springs to zero first, so no click moves the robot.", (...way) => {
  const [from, to] = way;
  const { box, does, drag, pass, take, drive } = openPanel();
  const choose = (name: string) => {
    const choices = [...box.querySelectorAll<HTMLElement>(".switch [role=radio]")];
    does(() => choices.find(({ textContent }) => textContent === name)!.click());
  };
  choose(from);
  const { track } = drag("Forward", 0.5);
  pass(40, READY);
  take();
  choose(to);
  expect([drive.held.value, drive.asked.value.x]).toEqual([false, 0]);
  fire(track, "pointermove", { pointerId: 1, button: 0, clientX: 180 });
  pass(100, READY);
  expect(take("drive", "preview").every(({ t, twist }) => t === "preview" && !twist)).toBe(true);
});

test("Keep value also keeps the value of an arrow key.", () => {
  const { click, find, does, pass, take, drive } = openPanel();
  click("More about the sliders");
  click("Keep value");
  const track = find("[aria-label=Forward][role=slider]:not(.sr)");
  does(() => void press(track, "ArrowRight"));
  does(() => void lift(track, "ArrowRight"));
  pass(40, READY);
  expect(drive.alone.value).toBe(true);
  expect(take("drive").at(-1)).toMatchObject({ vx: 2 });
});

test("Home on one slider centres all of them.", () => {
  const { find, drag, pass, does, drive } = keeping();
  drag("Left", -0.5).letGo();
  drag("Turn left", -0.5).letGo();
  pass(40, READY);
  expect(Object.values(drive.asked.value).every((each) => each > 0)).toBe(true);
  does(() => void press(find('[aria-label="Turn left"][role=slider]'), "Home"));
  expect(drive.asked.value).toEqual({ x: 0, y: 0, turn: 0 });
});
