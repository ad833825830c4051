import { signal } from "@preact/signals";
import axe from "axe-core";
import { render } from "preact";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Plots } from "../../src/plots/plots.tsx";
import { Recorder } from "../../src/plots/recorder.ts";
import type { Session } from "../../src/session.ts";
import { texts } from "../../src/text/text.ts";
import { draw } from "../support/draw.tsx";
import { fakeCanvas } from "../support/fake_canvas.ts";
import { connect, ROBOT } from "../support/fake_link.ts";

const { plots: words } = texts();

beforeEach(() => {
  localStorage.clear();
  fakeCanvas();
});
afterEach(() => {
  render(null, document.body);
  vi.restoreAllMocks();
  vi.useRealTimers();
});

async function open() {
  const page = connect();
  const recorder = new Recorder(page.link);
  const said: string[] = [];
  const notice = { say: (text: string) => said.push(text) };
  const session = { link: page.link, recorder, notice, view: { dark: signal(true) } };
  page.say(ROBOT);
  recorder.choose({ windowS: 20, panes: [["twist.vx"], ["twist.omega"], ["pose.x"]] });
  let robot_s = 0;
  const run = async (ms: number) => {
    for (let i = 0; i < ms; i += 50) {
      page.state({ robot_s: (robot_s += 0.05) });
      await vi.advanceTimersByTimeAsync(50);
    }
  };
  await run(100);
  draw(<Plots />, session as unknown as Session, document.body);
  await run(500);
  const button = (text: string) =>
    [...document.querySelectorAll<HTMLElement>("button")].find((each) =>
      [
        each.getAttribute("aria-label"),
        each.getAttribute("aria-description"),
        each.textContent,
      ].includes(text),
    )!;
  const press = async (text: string) => {
    button(text).click();
    await run(100);
  };
  const values = () => [...document.querySelectorAll(".series .value")].map((v) => v.textContent);
  return { ...page, recorder, said, run, button, press, values };
}

test("A field moves to another pane by its menu, but not to a third unit.", async () => {
  const { recorder, button, press } = await open();
  expect(document.querySelectorAll(".chart .uplot")).toHaveLength(3);
  await press(words.fieldMenu("twist.omega"));
  await press(words.moveTo(1));
  expect(recorder.layout.value.panes).toEqual([["twist.vx", "twist.omega"], ["pose.x"]]);
  expect(document.querySelectorAll(".chart .uplot")).toHaveLength(2);
  await press(words.fieldMenu("pose.x"));
  expect(button(words.moveTo(1)).getAttribute("aria-disabled")).toBe("true");
  await press(words.moveTo(1));
  expect(recorder.layout.value.panes).toHaveLength(2);
  await press(words.removeField);
  expect(recorder.names).toEqual(["twist.vx", "twist.omega"]);
});

test("A dragged field moves into the pane where it is dropped.", async () => {
  const { recorder, run } = await open();
  const series = document.querySelectorAll(".series");
  const charts = document.querySelectorAll(".chart");
  expect(document.querySelector(".drop")).toBe(null);
  series[1]!.dispatchEvent(new Event("dragstart", { bubbles: true }));
  await run(50);
  expect(document.querySelector(".drop")).not.toBe(null);
  const over = new Event("dragover", { bubbles: true, cancelable: true });
  charts[0]!.dispatchEvent(over);
  expect(over.defaultPrevented).toBe(true);
  charts[0]!.dispatchEvent(new Event("drop", { bubbles: true }));
  await run(50);
  expect(recorder.layout.value.panes).toEqual([["twist.vx", "twist.omega"], ["pose.x"]]);
});

test("Values follow the robot, and are dashes when it is silent, unless plots are paused.", async () => {
  const { values, press, run } = await open();
  expect(values()).toEqual(["0.100", "0.30", "1.000"]);
  await vi.advanceTimersByTimeAsync(600);
  expect(values()).toEqual(["–", "–", "–"]);
  expect(document.querySelector(".charts.stale")).not.toBe(null);
  await run(100);
  await press(words.pause);
  await vi.advanceTimersByTimeAsync(600);
  expect(values()).toEqual(["0.100", "0.30", "1.000"]);
});

test("A sample that arrives after the pause is not plotted, however old it is.", async () => {
  const { recorder, button, state, run } = await open();
  const shown = () => recorder.buffer.places(-Infinity, recorder.endS.value!)[1];
  const newestS = recorder.buffer.newestS;
  await vi.advanceTimersByTimeAsync(40);
  button(words.pause).click();
  const before = shown();
  state({ robot_s: newestS + 0.01 });
  await run(0);
  expect(recorder.buffer.newestS).toBeCloseTo(newestS + 0.01);
  expect(shown()).toBe(before);
});

test("A named layout comes back, and a copied link has the same layout.", async () => {
  const { recorder, press, run, said } = await open();
  const before = recorder.layout.value;
  await press(words.layouts);
  await press(words.saveAs);
  const input = document.querySelector<HTMLInputElement>(".tools form input")!;
  input.value = "  Ausflug ";
  input.form!.dispatchEvent(new Event("submit", { cancelable: true }));
  await run(50);
  recorder.choose(null);
  await run(50);
  await press(words.layouts);
  await press("Ausflug");
  expect(recorder.layout.value).toEqual(before);
  const write = vi.fn(async (_: string) => {});
  vi.spyOn(navigator, "clipboard", "get").mockReturnValue({ writeText: write } as never);
  await press(words.copyLink);
  const link = new URL(write.mock.calls[0]![0]);
  expect(link.searchParams.get("plots")).toBe("20:twist.vx;twist.omega;pose.x");
  expect(said).toEqual([words.copied]);
});

test("A field is found by a part of its name, and joins its like.", async () => {
  const { recorder, press, run } = await open();
  await press(words.fields);
  const input = document.querySelector<HTMLInputElement>(".chooser input")!;
  input.value = "COMMANDED vx";
  input.dispatchEvent(new Event("input", { bubbles: true }));
  await run(50);
  const found = [...document.querySelectorAll<HTMLElement>("[role=checkbox]")];
  expect(found).toHaveLength(1);
  found[0]!.click();
  await run(50);
  expect(recorder.layout.value.panes[0]).toEqual(["twist.vx", "commanded.vx"]);
  expect(found[0]!.getAttribute("aria-checked")).toBe("true");
});

test("Arrow keys move the cursor, whose sample is shown beside every plot.", async () => {
  const { values, state, button } = await open();
  for (let i = 1; i <= 400; i += 1)
    state({ robot_s: 100 + i / 20, twist: [i / 100, 0, i / 100], pose: [i / 100, 0, 0] });
  button(words.pause).click();
  await vi.advanceTimersByTimeAsync(100);
  const area = document.querySelector<HTMLElement>(".charts")!;
  const box = new DOMRect(0, 0, 540, 100);
  vi.spyOn(HTMLElement.prototype, "getBoundingClientRect").mockReturnValue(box);
  const move = async (key: string) => {
    area.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
    await vi.advanceTimersByTimeAsync(50);
    const [vx, omega, x] = values().map(Number);
    expect([vx, omega]).toEqual([expect.closeTo(x!, 1), expect.closeTo(x!, 1)]);
    return x!;
  };
  const middle = await move("ArrowLeft");
  expect(middle).toBeGreaterThan(1.5);
  expect(middle).toBeLessThan(2.5);
  let before = middle;
  for (let i = 0; i < 20; i += 1) before = await move("ArrowLeft");
  expect(before).toBeLessThan(middle);
  for (let i = 0; i < 40; i += 1) before = await move("ArrowRight");
  expect(before).toBeGreaterThan(middle);
});

test("axe finds nothing in the plots with the list of fields.", async () => {
  const { press } = await open();
  await press(words.fields);
  vi.useRealTimers();
  const rules = { "color-contrast": { enabled: false }, region: { enabled: false } };
  const { violations } = await axe.run(document.body, { rules });
  expect(violations.map(({ id, nodes }) => [id, nodes.map(({ html }) => html)])).toEqual([]);
});
