import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { turned } from "../../src/drive/sphere";
import { openSession, press, ROBOT } from "./support";

const SPHERE = { ...ROBOT, id: "atlas", space: "sphere" } as const;
const UPRIGHT = { sphere: { wxyz: [1, 0, 0, 0] } };
const FRONT = [1, 0, 0] as const;

beforeEach(() => {
  vi.useFakeTimers();
});

afterEach(() => {
  vi.useRealTimers();
});

function open() {
  const page = openSession(SPHERE);
  page.state(UPRIGHT);
  page.take();
  return page;
}

test("A click of this page turns the point to the top; one of another page moves nothing.", () => {
  const { session, say, take } = open();
  const click = { t: "sphere_click", robot: "atlas", at: FRONT };
  say(click);
  expect(session.drive.held.value).toBe(false);
  session.sphere.clicked();
  say({ ...click, robot: "tsd" });
  expect(session.drive.held.value).toBe(false);
  session.sphere.clicked();
  say(click);
  const [drive] = take("drive");
  // The front comes up by a turn about minus y.
  expect(drive).toMatchObject({ omega: 0 });
  expect(drive!["vx"]).toBeCloseTo(0);
  expect(drive!["vy"]).toBeLessThan(0);
});

test("The commanded rotation brings the point to the top and then ends.", () => {
  const { session, state } = open();
  session.sphere.bring([0, 1, 0]);
  let angle = 0; // About x, from the left to the top.
  for (let i = 0; i < 200 && session.sphere.held; i++) {
    const [x, y] = [session.drive.asked.peek().y, session.drive.asked.peek().x];
    angle += 0.05 * -x; // Rolling left is about minus x.
    expect(y).toBeCloseTo(0);
    const wxyz = [Math.cos(angle / 2), Math.sin(angle / 2), 0, 0] as const;
    state({ sphere: { wxyz } });
  }
  expect(session.sphere.held).toBe(false);
  const [, , z] = turned([Math.cos(angle / 2), Math.sin(angle / 2), 0, 0], [0, 1, 0]);
  expect(z).toBeGreaterThan(0.99);
});

test("Another control, a stop and too long a time end it.", () => {
  const { session, state } = open();
  session.sphere.bring(FRONT);
  press("KeyW");
  expect(session.sphere.held).toBe(false);
  press("KeyW", "keyup");
  session.sphere.bring(FRONT);
  session.stop.press();
  expect(session.sphere.held).toBe(false);
  session.sphere.bring(FRONT);
  for (let i = 0; i < 320; i++) {
    vi.advanceTimersByTime(100);
    state(UPRIGHT);
  }
  expect(session.sphere.held).toBe(false);
});
