import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { wasDriven } from "../../src/panel/first_drive";
import { fakeBrowser } from "../support/page";
import { openPanel } from "../support/panel";

beforeEach(fakeBrowser);
afterEach(() => void vi.useRealTimers());

/** A page in a browser that has not been here before. */
function firstVisit() {
  wasDriven.value = false;
  const panel = openPanel();
  const now = () => panel.find(".first [aria-current] b")?.textContent ?? null;
  return { ...panel, now };
}

test("The four steps follow the robot, and are gone at the next visit.", () => {
  const { state, now, text, click, find } = firstVisit();
  state({ mode: "disarmed" }, { has_control: false });
  expect(now()).toBe("Take control");
  state({ mode: "disarmed" }, { has_control: true });
  expect(now()).toBe("Arm");
  state({ mode: "ready" }, { has_control: true });
  expect(now()).toBe("Drive");
  state({ mode: "driving" }, { has_control: true });
  expect(now()).toBe("Stop");
  state({ mode: "ready" }, { has_control: true });
  expect(now()).toBe("Stop");
  state({ mode: "stopped" }, { has_control: true });
  expect(now()).toBeNull();
  expect(text(".first")).toContain("done");
  click("Close");
  expect(find(".first")).toBeNull();
  expect(wasDriven.value).toBe(true);
});

test("Who loses control begins again, unless they drove already.", () => {
  const { state, now } = firstVisit();
  state({ mode: "ready" }, { has_control: true });
  state({ mode: "ready" }, { has_control: false });
  expect(now()).toBe("Take control");
});

test("The steps can be skipped.", () => {
  const { click, find } = firstVisit();
  click("Skip");
  expect(find(".first")).toBeNull();
});
