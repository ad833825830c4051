import axe from "axe-core";
import { render } from "preact";
import { act } from "preact/test-utils";
import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";

import { Bar } from "../../src/bar/bar";
import { nameOperatorsBy } from "../../src/text/reasons";
import { language } from "../../src/text/text";
import { draw } from "../support/draw";
import { type FakePage, ME, openPage, type StateChange } from "../support/fake_page";

let page: FakePage;
let root: HTMLElement;

async function open(welcome: Record<string, unknown> = {}): Promise<void> {
  page = await openPage(welcome);
  nameOperatorsBy(page.session.link);
  root = document.body.appendChild(document.createElement("div"));
  draw(<Bar />, page.session, root);
}

beforeEach(async () => {
  localStorage.clear();
  language.value = "en";
  await open();
});
afterEach(() => {
  location.hash = "";
  render(null, root);
  root.remove();
  vi.useRealTimers();
});

const text = () => root.textContent ?? "";
const mode = () => root.querySelector("[role=status]")?.textContent;
const state = (change?: StateChange) => act(() => page.state(change));
const pass = (ms: number) => act(() => page.pass(ms));
// The key of a button follows its text.
const button = (label: string) =>
  [...root.querySelectorAll<HTMLElement>("button, a")].find((each) =>
    (each.getAttribute("aria-label") ?? each.textContent).startsWith(label),
  );
const press = (label: string) => act(() => button(label)!.click());

describe("the mode", () => {
  test.each([
    ["disarmed", "Disarmed"],
    ["driving", "Driving"],
    ["fault", "Fault"],
  ])("%s is shown by its word", async (name, word) => {
    await state({ mode: name });
    expect(mode()).toBe(word);
  });

  test("is not shown of a robot that is silent, nor who drives it", async () => {
    expect(mode()).toBe("Connecting");
    await state({ mode: "driving" });
    await pass(500);
    expect(mode()).toBe("No signal");
    expect(text()).not.toContain("You drive");
    expect(button("Disarm")).toBeUndefined();
    await act(() => page.disconnect());
    expect(mode()).toBe("No signal");
  });

  test("of a replay on the bus is that of no robot", async () => {
    await state({ mode: "driving", state: { source: "recording" } });
    expect(mode()).toBe("Replay");
    expect(text()).toContain("no robot is in view");
    expect(button("Disarm")).toBeUndefined();
  });
});

describe("who drives", () => {
  const names = { operators: { bob: "محمد" } };

  test("is you, another by name, or nobody", async () => {
    await state();
    expect(text()).toContain("You drive");
    await state({ lease: { holder: "bob" }, status: names });
    expect([...root.querySelectorAll("bdi")].map((bdi) => bdi.textContent)).toContain("محمد");
    expect(text()).toContain("محمد drives");
    await state({ lease: { holder: null } });
    expect(text()).toContain("Control is free");
    await state({ lease: { holder: null, reserved_for: "bob" }, status: names });
    expect(text()).toContain("Control is kept for محمد");
  });

  test("is beside what a viewer may do, who has no actions", async () => {
    await act(() =>
      page.say({ t: "welcome", operator: ME, role: "viewer", robots: [], robot: "tsd" }),
    );
    await state({ lease: { holder: "bob" } });
    expect(text()).toContain("You may look");
    expect(text()).toContain("bob drives");
    expect(button("Take over")).toBeUndefined();
  });

  test("can disarm while the robot is armed, and release control", async () => {
    await state({ mode: "ready" });
    await press("Disarm");
    expect(page.sent("disarm")).toHaveLength(1);
    await act(() => page.say({ t: "reply", to: "disarm", ok: true, why: null }));
    await state({ mode: "disarmed" });
    expect(button("Disarm")).toBeUndefined();
    await press("Release control");
    expect(page.sent("lease")).toEqual([{ t: "lease", op: "release" }]);
  });

  test("cannot press an action again while its request is under way", async () => {
    await state();
    await press("Disarm");
    await press("Disarm");
    expect(page.sent("disarm")).toHaveLength(1);
    for (let i = 0; i < 3; i++) {
      await pass(1000); // No answer.
      await state();
    }
    await press("Disarm");
    expect(page.sent("disarm")).toHaveLength(2);
  });
});

describe("a take-over", () => {
  beforeEach(() => state({ lease: { holder: "bob" } }));

  test("is confirmed, with a reason", async () => {
    await press("Take over");
    expect(page.sent("lease")).toEqual([]);
    expect(text()).toContain("bob drives and loses control.");
    root.querySelector("input")!.value = " it is on fire ";
    await act(() => root.querySelector("form")!.requestSubmit());
    const request = { op: "acquire", take_over: true, reason: "it is on fire", max_age_s: 0.11 };
    expect(page.sent("lease")).toEqual([{ t: "lease", ...request }]);
    expect(root.querySelector("[role=dialog]")).toBeNull();
  });

  test("is not confirmed any more once another operator drives", async () => {
    await press("Take over");
    await state({ lease: { holder: "carol" } });
    expect(root.querySelector("[role=dialog]")).toBeNull();
  });

  test.each([
    ["slow", { rtt_ms: 300 }, 0.7],
    ["uneven", { rtt_ms: 40, rtt_jitter_ms: 200 }, 0.34],
  ])("over a %s link allows older commands", async (_, trip, max_age_s) => {
    await state({ lease: { holder: "bob" }, state: trip });
    await press("Take over");
    await act(() => root.querySelector("form")!.requestSubmit());
    expect(page.sent("lease")[0]).toMatchObject({ max_age_s });
    expect(page.sent("lease")[0]).not.toHaveProperty("reason");
  });
});

describe("a request for control", () => {
  const asked = { requested_by: "bob", request_expires_in_s: 13.2 };

  test.each([
    ["Hand over", "grant"],
    ["Keep control", "deny"],
  ])("is answered by who drives: %s", async (label, op) => {
    await state({ lease: asked });
    await act(() => void (page.session.path.going.value = true));
    expect(root.querySelector("[role=alert]")?.textContent).toBe(
      "bob asks for control. You drive on until you hand over.",
    );
    expect(text()).toContain("14 s");
    await press(label);
    expect(page.sent("lease")).toEqual([{ t: "lease", op, requester: "bob" }]);
  });

  test("takes no focus", async () => {
    const before = document.activeElement;
    await state({ lease: asked });
    expect(document.activeElement).toBe(before);
  });

  test("is answered in the deck alone unless a held path keeps it", async () => {
    await state({ lease: asked });
    expect(root.querySelector(".asks")).toBeNull();
    expect(root.querySelector("[role=alert]")?.textContent).toContain("bob asks for control.");
  });

  test("of others is no business of a third", async () => {
    await state({ lease: { holder: "carol", requested_by: "bob" } });
    expect(text()).not.toContain("bob");
  });
});

describe("the link", () => {
  const link = () => root.querySelector(".link")?.textContent;

  test("has the figure that explains its grade, and opens Health", async () => {
    await state({ state: { rtt_ms: 12, rtt_jitter_ms: 1 } });
    expect(link()).toContain("Good 12ms");
    await state({ state: { rtt_ms: 20, rtt_jitter_ms: 74 } });
    expect(link()).toContain("Uneven 74ms jitter");
    await act(() => root.querySelector<HTMLElement>(".link")!.click());
    expect(page.session.layout.tab.value).toBe("health");
  });

  test("that is lost has no figure", async () => {
    await state();
    await pass(500);
    expect(link()).toContain("No link");
    expect(link()).not.toMatch(/\d/);
  });
});

test("the battery is low when the robot says so, and unknown of a silent robot", async () => {
  const low = { code: "battery_low", params: { volts: 11 } };
  const limits = { speed_mps: 1, turn_rate_rad_per_s: 1, max_command_age_s: 0.2, why: [low] };
  const battery = () => root.querySelector(".battery")?.textContent ?? null;
  await state();
  expect(battery()).toBeNull();
  await state({ status: { hardware: { battery_v: 12.4 } } });
  expect(battery()).toBe("Battery: 12.4V");
  await state({ status: { hardware: { battery_v: 10.6 }, limits } });
  expect(battery()).toBe("Battery: Low10.6V");
  await pass(500);
  expect(battery()).toBe("Battery: –V");
});

describe("a typed name", () => {
  test.each(["Ольга", "王小明", "  J. O'Neill!  ", "Łukasz", "e\u0301va"])(
    "%s is kept in its script, without a new connection",
    async (typed) => {
      const socket = page.session.link;
      await press("Your name");
      root.querySelector("input")!.value = typed;
      await act(() => root.querySelector("form")!.requestSubmit());
      const name = typed.trim().normalize("NFC");
      expect(page.sent("name")).toEqual([{ t: "name", name }]);
      expect(page.session.name.value).toBe(name);
      expect(socket.connected.value).toBe(true);
      expect(text()).toContain(name);
    },
  );

  test("has 40 characters at most, none of them cut in two", () => {
    page.session.rename("𝒳".repeat(99));
    expect(page.sent("name")).toEqual([{ t: "name", name: "𝒳".repeat(40) }]);
  });

  test("is not typed by who is logged in", async () => {
    await act(() =>
      page.say({ t: "welcome", operator: ME, role: "operator", user: "eva", robots: [] }),
    );
    await press("Your name: eva");
    expect(text()).toContain("You are logged in as eva.");
    expect(root.querySelector("input")).toBeNull();
    expect(button("Log out")).toBeDefined();
  });
});

describe("several robots", () => {
  const robots = [
    { id: "tsd", title: "Triple singularity drive", colour: "#1d96fe" },
    { id: "kiwi", title: "Three-wheel omni drive", colour: "#ff7700" },
  ];

  test("can be chosen from", async () => {
    await act(() => page.say({ t: "welcome", operator: ME, role: "operator", user: null, robots }));
    await press("Robot: tsd. Choose another");
    const items = [...root.querySelectorAll<HTMLElement>("[role=menuitemradio]")];
    expect(items.map((item) => item.getAttribute("aria-checked"))).toEqual(["true", "false"]);
    await act(() => items[1]!.click());
    expect(page.sent("robot").at(-1)).toEqual({ t: "robot", id: "kiwi" });
  });
});

test("Escape closes a dialog whatever has the focus", async () => {
  await state();
  await act(() => void dispatchEvent(new KeyboardEvent("keydown", { key: "?" })));
  expect(root.querySelector("[role=dialog]")).not.toBeNull();
  const escape = new KeyboardEvent("keydown", { code: "Escape", bubbles: true });
  await act(() => void document.body.dispatchEvent(escape));
  expect(root.querySelector("[role=dialog]")).toBeNull();
});

test("the sheet of keys opens with ?, at its top, and sets language and theme", async () => {
  await state();
  const key = () => act(() => void dispatchEvent(new KeyboardEvent("keydown", { key: "?" })));
  await key();
  const dialog = root.querySelector<HTMLElement>("[role=dialog]")!;
  expect(dialog.querySelector("kbd")?.textContent).toBe("Space");
  expect(document.activeElement).toBe(dialog);
  await press("Dark");
  expect(page.session.view.settings.value.dark).toBe(true);
  await press("Deutsch");
  expect(mode()).toBe("Bereit");
  expect(dialog.querySelector("kbd")?.textContent).toBe("Leertaste");
  await key();
  expect(root.querySelector("[role=dialog]")).toBeNull();
});

test("a gamepad is shown, and opens the list of what its controls do", async () => {
  await state();
  expect(button("Gamepad")).toBeUndefined();
  await act(() => void (page.session.gamepad.name.value = "054c-0ce6-Wireless Controller"));
  await press("Gamepad");
  expect(root.querySelector("[role=dialog]")?.textContent).toContain("Right stick");
});

test("on the screen of all robots there is a way back, and no mode of one", async () => {
  await state();
  const { pathname, search } = location;
  expect(button("Fleet")?.getAttribute("href")).toBe(`${pathname}${search}#fleet`);
  await act(() => {
    location.hash = "#fleet";
    page.session.layout.screen.value = "fleet";
  });
  expect(root.querySelector("[role=status]")).toBeNull();
  expect(button("Back to tsd")?.getAttribute("href")).toBe(`${pathname}${search}#`);
});

test("axe finds nothing in the bar, its menu and its dialogs", async () => {
  const violations = async () => {
    vi.useRealTimers();
    const rules = { "color-contrast": { enabled: false }, region: { enabled: false } };
    const found = await axe.run(root, { rules });
    return found.violations.map(({ id, nodes }) => [id, nodes.map(({ html }) => html)]);
  };
  await state({ lease: { requested_by: "bob", request_expires_in_s: 9 } });
  expect(await violations()).toEqual([]);
  await press("Keys and settings");
  expect(await violations()).toEqual([]);
});
