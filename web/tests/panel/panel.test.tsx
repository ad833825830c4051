import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Layout, TABS } from "../../src/store/layout";
import { fakeCanvas } from "../support/fake_canvas";
import { fakeBrowser, press } from "../support/page";
import { openPanel } from "../support/panel";

beforeEach(() => {
  fakeBrowser();
  fakeCanvas(); // For the plots.
});
afterEach(() => {
  vi.restoreAllMocks();
  vi.useRealTimers();
});

test("Arrow keys, Home and End choose a tab, which takes the focus.", () => {
  const { find, does, session } = openPanel();
  const move = (code: string) => does(() => void press(document.activeElement, code));
  const chosen = () => find("[role=tab][aria-selected=true]");
  chosen().focus();
  for (const tab of [...TABS.slice(1), "drive"]) {
    move("ArrowRight");
    expect(session.layout.tab.value).toBe(tab);
    expect(document.activeElement).toBe(chosen());
    expect(find("[role=tabpanel]").getAttribute("aria-labelledby")).toBe(chosen().id);
  }
  move("ArrowLeft");
  expect(session.layout.tab.value).toBe("student");
  move("Home");
  expect(session.layout.tab.value).toBe("drive");
  move("End");
  expect(session.layout.tab.value).toBe("student");
  expect(find(".tabs").querySelectorAll("[role=tab][tabindex='0']")).toHaveLength(1);
});

test("Each tab keeps its scroll, also while the panel is folded.", () => {
  const { find, click, does } = openPanel();
  const scrollTo = (top: number) => {
    const body = find(".body");
    body.scrollTop = top;
    does(() => void body.dispatchEvent(new Event("scroll")));
  };
  scrollTo(120);
  click("View");
  expect(find(".body").scrollTop).toBe(0);
  scrollTo(40);
  click("Drive");
  expect(find(".body").scrollTop).toBe(120);
  click("Fold the panel away");
  click("Open the panel");
  expect(find(".body").scrollTop).toBe(120);
  click("View");
  expect(find(".body").scrollTop).toBe(40);
});

test("P folds the panel and opens it; in between a handle stays.", () => {
  const { find, does } = openPanel();
  const toggle = () => does(() => void press(document.body, "KeyP"));
  toggle();
  expect(find(".panel")).toBeNull();
  expect(find(".unfold button")).not.toBeNull();
  toggle();
  expect(find(".panel")).not.toBeNull();
  expect(find(".unfold")).toBeNull();
});

test("The focus goes from the button that folds to the one that opens, and back to the tab.", () => {
  const { find, click } = openPanel();
  click("Fold the panel away");
  expect(document.activeElement).toBe(find(".unfold button"));
  click("Open the panel");
  expect(document.activeElement).toBe(find("[role=tab][aria-selected=true]"));
});

test("On a phone, five tabs open a sheet, and the one that is open closes it.", () => {
  const { find, box, does, session } = openPanel();
  does(() => {
    session.layout.phone.value = true;
    session.layout.narrow.value = true;
  });
  expect(find(".panel")).toBeNull();
  const tabs = box.querySelectorAll<HTMLElement>(".phone-tabs button");
  expect(tabs).toHaveLength(5);
  does(() => tabs[4]!.click());
  expect(find(".panel h2").textContent).toBe("View");
  expect(tabs[4]!.getAttribute("aria-expanded")).toBe("true");
  does(() => tabs[4]!.click());
  expect(find(".panel")).toBeNull();
  does(() => tabs[0]!.click());
  does(() => void press(find(".panel .body"), "Escape"));
  expect(find(".panel")).toBeNull();
});

test("Settings of the View tab reach the dashboard, and those from elsewhere the tab.", () => {
  const { click, find, does, socket, take, session } = openPanel();
  click("View");
  const box = (name: string) =>
    [...document.querySelectorAll<HTMLInputElement>(".tick input")].find(
      ({ parentElement }) => parentElement!.textContent === name,
    );
  const trail = box("Trail")!;
  take();
  does(() => trail.click());
  expect(socket.sent.at(-1)).toMatchObject({ t: "view", settings: { hidden: ["trail"] } });
  expect(box("Camera above the floor")).toBeUndefined();
  does(() => (session.pictures.cameras.value = [{ key: "floor/a", name: "a", robot: null }]));
  does(() => box("Camera above the floor")!.click());
  expect(socket.sent.at(-1)).toMatchObject({ t: "view", settings: { floor_camera: true } });
  click("Dark");
  expect(document.documentElement.dataset["theme"]).toBe("dark");
  click("Light");
  expect(document.documentElement.dataset["theme"]).toBe("light");
  does(() => session.view.set({ hidden: [], tilt: "x10" }));
  expect(trail.checked).toBe(true);
  const tilt = find('[aria-label="Tilt drawn"] [aria-checked=true]');
  expect(tilt.textContent).toBe("× 10");
  click("Deutsch");
  expect(find("[role=tab][aria-selected=true]").textContent).toBe("Ansicht");
  click("English");
});

test.each(["plots", "student"] as const)(
  "A link to %s opens that tab, also of a folded panel.",
  (tab) => {
    localStorage.setItem("tsd-folded", "true");
    history.replaceState(null, "", `?${tab}=a`);
    const layout = new Layout();
    history.replaceState(null, "", location.pathname);
    expect([layout.tab.value, layout.panelOpen.value]).toEqual([tab, true]);
  },
);

test("A box of the View tab says that Enter ticks it, because the space bar stops.", () => {
  const { click, find } = openPanel();
  click("View");
  expect(find(".tick input").getAttribute("aria-description")).toBe(
    "Enter ticks it; the space bar stops the robot.",
  );
});
