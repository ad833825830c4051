import { render } from "preact";
import { afterEach, expect, test, vi } from "vitest";
import { Health } from "../../src/health/health.tsx";
import { texts } from "../../src/text/text.ts";
import { draw } from "../support/draw.tsx";
import { connect, ROBOT } from "../support/fake_link.ts";

afterEach(() => {
  render(null, document.body);
  vi.useRealTimers();
});

const flush = () => vi.advanceTimersByTimeAsync(400);

test("The shadow twin is compared only while Health is shown, also after a new connection.", async () => {
  const page = connect();
  page.say(ROBOT);
  page.state();
  expect(page.take("shadow")).toEqual([]);
  draw(<Health />, page, document.body);
  await flush();
  expect(page.take("shadow")).toEqual([{ t: "shadow", on: true }]);
  draw(null, page, document.body);
  await flush();
  expect(page.take("shadow")).toEqual([{ t: "shadow", on: false }]);
});

test("Rows outside come first and open; groups count the rest; events are sentences.", async () => {
  const page = connect();
  page.say(ROBOT);
  page.say({ t: "event", kind: "mode", text: "", why: { code: "released" }, robot_s: 1, age_s: 0 });
  const slow = { loop: { hz: 80, overruns: 0, jitter_p99_ms: 1, longest_ms: 9 } };
  page.state({}, slow);
  draw(<Health />, page, document.body);
  for (let i = 0; i < 8; i += 1) {
    await vi.advanceTimersByTimeAsync(50);
    page.state({}, slow);
  }
  const { health } = texts();
  const text = (selector: string) => document.querySelector(selector)?.textContent ?? "";
  expect(text(".verdict b")).toContain(health.findings(1));
  expect(text(".reading.l1 p")).not.toBe("");
  expect(document.querySelector(".reading.l1")!.closest("details")).toBe(null);
  expect(document.body.textContent).toContain(health.fine(2));
  expect(text(".feed li span")).toBe("Released.");
  const time = document.querySelector<HTMLTimeElement>(".feed time")!;
  expect(time.title).toBe(time.dateTime);
  expect(Number.isNaN(Date.parse(time.dateTime))).toBe(false);
});
