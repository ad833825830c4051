import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Card } from "../../src/fleet/card";
import type { FleetRobot } from "../../src/generated/wire";
import { draw } from "../support/draw";
import { fakeBrowser, openPage } from "../support/page";

beforeEach(fakeBrowser);
afterEach(() => vi.useRealTimers());

const STOPPED = {
  id: "kiwi",
  title: "Kiwi",
  colour: "#1d96fe",
  panel: "wheels",
  wheel_count: 3,
  space: "floor",
  source: "robot",
  silent: false,
  age_s: 0,
  mode: "stopped",
  latched: true,
  why: { code: "stop_requested", params: { by: "bob" } },
  driver: null,
  requested_by: null,
  operators: { bob: "Bob" },
  battery: null,
  event: null,
} as FleetRobot;

test("A card states why its robot has stopped, and why a stop did not reach it.", () => {
  const { session, say } = openPage();
  const show = () => {
    say({ t: "fleet", whole: true, robots: [STOPPED], poses: {} });
    draw(<Card row={session.fleet.rows.value[0]!} />, session, document.body);
    return document.querySelector<HTMLElement>(".card-stop")!;
  };
  expect(show().title).toBe("");
  expect(document.querySelector("dl")!.textContent).toContain("Bob");
  say({ t: "stop_result", robot: "kiwi", outcome: "not_reached", why: { code: "no_answer" } });
  const { title, ariaLabel } = show();
  expect(title).not.toBe("");
  expect(ariaLabel ?? show().getAttribute("aria-label")).toContain(title);
  say({ t: "stop_result", robot: "kiwi", outcome: "sent", why: null });
  expect(show().title).toBe("");
});
