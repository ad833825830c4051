import { render } from "preact";
import { act } from "preact/test-utils";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { RecordingRow } from "../../src/generated/wire";
import { Library } from "../../src/timeline/library";
import { Recordings } from "../../src/timeline/recordings";
import { draw } from "../support/draw";
import { openLink, type Wire, WELCOME } from "./link";

type Answer = { status?: number; body?: unknown };
let answers: (method: string, path: string) => Answer;
let asked: string[];
let wire: Wire;

const ROW: RecordingRow = {
  name: "a b.mcap",
  title: "Square",
  start_ms: 1_764_290_843_000,
  duration_s: 761,
  robots: ["tsd"],
  size_bytes: 18_200_000,
  writing: false,
  marks: 0,
  notes: [],
  details: { drivers: ["Eva"], stops: 1, faults: 0, paths: [] },
  details_pending: false,
};

beforeEach(() => {
  vi.useFakeTimers();
  asked = [];
  answers = () => ({ body: [] });
  vi.stubGlobal("fetch", (address: URL, init: RequestInit) => {
    const path = address.pathname.replace(/^.*\/recordings\/?/, "") + address.search;
    asked.push(`${init.method} ${path}`);
    const { status = 200, body } = answers(init.method!, path);
    if (status === 0) return Promise.reject(new TypeError("network"));
    return Promise.resolve(new Response(status === 204 ? null : JSON.stringify(body), { status }));
  });
  wire = openLink();
});

afterEach(() => {
  render(null, document.body);
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

const settle = () => act(() => vi.advanceTimersByTimeAsync(3000) as unknown as Promise<void>);

async function show(): Promise<void> {
  const library = new Library(wire.link);
  library.open.value = true;
  draw(<Recordings />, { link: wire.link, library }, document.body);
  await settle();
}

const page = () => document.body.textContent;

async function press(name: string): Promise<void> {
  const buttons = [...document.querySelectorAll("button")];
  const button = buttons.find((each) =>
    (each.getAttribute("aria-label") ?? each.textContent)!.startsWith(name),
  );
  await act(() => button!.click());
  await settle();
}

test.each<[string, Answer]>([
  ["no folder", { status: 204 }],
  ["There are no recordings yet", { body: [] }],
  ["could not be loaded", { status: 0 }],
  ["could not be loaded", { status: 500, body: "broken" }],
])("Without rows, the list says why: %s", async (text, answer) => {
  answers = () => answer;
  await show();
  expect(page()).toContain(text);
});

test("A search without results says where it looked, and asks the dashboard once per pause", async () => {
  answers = (_, path) => ({ body: path === "?q=" ? [ROW] : [] });
  await show();
  const input = document.querySelector("input")!;
  for (const typed of ["f", "fa", "fault"]) {
    input.value = typed;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }
  await settle();
  expect(asked.filter((each) => each.includes("q=f"))).toEqual(["GET ?q=fault"]);
  expect(page()).toContain("Nothing matches");
});

test("A row has name, length, driver, stops and size, or says that it is being read", async () => {
  const pending = { ...ROW, name: "c.mcap", title: "Other", details: null, details_pending: true };
  answers = (_, path) => ({ body: path.startsWith("?") ? [ROW, pending] : [] });
  await show();
  const [first, second] = [...document.querySelectorAll(".rec")].map((row) => row.textContent);
  for (const part of ["Square", "12:41", "Eva", "1 stop", "18 MB"]) expect(first).toContain(part);
  expect(second).toContain("still being read");
});

test("Of hundreds of rows, few are drawn until more are asked for", async () => {
  const rows = Array.from({ length: 300 }, (_, i) => ({ ...ROW, name: `${i}.mcap` }));
  answers = (_, path) => ({ body: path.startsWith("?") ? rows : [] });
  await show();
  const drawn = document.querySelectorAll(".rec").length;
  expect(drawn).toBeLessThanOrEqual(50);
  await press(`Show ${300 - drawn} more`);
  expect(document.querySelectorAll(".rec").length).toBeGreaterThan(drawn);
});

test("A deletion can be undone", async () => {
  const deleted = {
    id: "7",
    name: ROW.name,
    title: "Square",
    by: "eva",
    deleted_ms: 0,
    size_bytes: 1,
  };
  answers = (method, path) => ({
    body: method === "DELETE" ? deleted : path.startsWith("?") ? [ROW] : [],
  });
  await show();
  await press("Square");
  await press("Export and delete");
  await press("Delete");
  expect(asked).toContain("DELETE a%20b.mcap");
  expect(page()).toContain("Deleted: Square");
  await press("Undo");
  expect(asked).toContain("POST trash/7/restore");
  expect(page()).not.toContain("Deleted:");
});

test("The recording that is being written cannot be deleted, and the button says so", async () => {
  answers = (_, path) => ({ body: path.startsWith("?") ? [{ ...ROW, writing: true }] : [] });
  await show();
  await press("Square");
  await press("Export and delete");
  await press("Delete");
  expect(asked.filter((each) => each.startsWith("DELETE"))).toEqual([]);
  const titles = [...document.querySelectorAll("button")].map(({ title }) => title);
  expect(titles).toContainEqual(expect.stringContaining("A recorder is writing this recording"));
});

test.each([
  [403, { code: "viewer", text: "viewers cannot do this" }, "Viewers cannot do this. Log in"],
  [422, { code: "failed", text: "the disk is full" }, "The disk is full."],
  [500, "a page of a proxy", "The dashboard did not answer."],
])("A refusal (%i) is shown as a sentence", async (status, body, text) => {
  answers = (method, path) =>
    method === "DELETE" ? { status, body } : { body: path.startsWith("?") ? [ROW] : [] };
  await show();
  await press("Square");
  await press("Export and delete");
  await press("Delete");
  expect(document.querySelector(".result")!.textContent).toContain(text);
});

test("Changes that others make appear, several of them with one request", async () => {
  await show();
  answers = (_, path) => ({ body: path.startsWith("?") ? [ROW] : [] });
  asked.length = 0;
  for (let count = 0; count < 20; count++) wire.hear({ t: "recordings_changed" });
  await settle();
  expect(asked.filter((each) => each.startsWith("GET ?"))).toHaveLength(1);
  expect(page()).toContain("Square");
});

test("A recorder that writes is found without the list, and missed once it has ended", async () => {
  answers = () => ({ body: [{ ...ROW, writing: true }] });
  const library = new Library(wire.link);
  wire.hear(WELCOME);
  await vi.advanceTimersByTimeAsync(3000);
  expect(library.written.value?.row.name).toBe(ROW.name);
  answers = () => ({ body: [ROW] });
  await vi.advanceTimersByTimeAsync(12_000);
  expect(library.written.value).toBeNull();
});
