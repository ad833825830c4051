import { signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";

import type {
  PageMessage,
  StudentKnob,
  StudentReply,
  StudentRequest,
} from "../../src/generated/wire";
import type { Link } from "../../src/store/link";
import { linkTo, type Setting, settingOf, StudentModel } from "../../src/student/model";
import { fromAbove } from "../../src/student/sketch";

const SETTING: Setting = {
  base: "tsd",
  knobs: {
    "drive.pivot_radius_m": 0.2,
    "drive.azimuths_deg.1": -150.5,
    "drive.max_tilt_deg": 1e-7,
  },
  twist: [0.1, -2, 1e-9],
  joints: null,
};
const KNOB = { key: "drive.max_tilt_deg", usual: 30, value: 30 } as StudentKnob;

class FakeLink {
  readonly beat = signal(0);
  sent: StudentRequest[] = [];
  #listeners = new Map<string, (message: never) => void>();

  on(kind: string, listener: (message: never) => void): () => void {
    this.#listeners.set(kind, listener);
    return () => {};
  }

  send(message: PageMessage): boolean {
    this.sent.push(message as StudentRequest);
    return true;
  }

  take(): StudentRequest[] {
    return this.sent.splice(0);
  }

  say(kind: string, message: unknown = {}): void {
    this.#listeners.get(kind)?.(message as never);
  }

  reply({ number, base }: StudentRequest, fields: Partial<StudentReply> = {}): void {
    const empty = { t: "student", number, base, bases: [], knobs: [KNOB], papers: [] };
    this.say("student", { ...empty, figures: null, problem: "", toml: null, ...fields });
  }
}

let link: FakeLink;

beforeEach(() => {
  vi.useFakeTimers();
  link = new FakeLink();
});
afterEach(() => void vi.useRealTimers());

function shown(query = ""): StudentModel {
  const model = new StudentModel(link as unknown as Link, query);
  model.show(true);
  return model;
}

/** Let time pass, with its heartbeats. */
function pass(ms: number): void {
  for (let past = 0; past < ms; past += 100) {
    vi.advanceTimersByTime(100);
    link.beat.value += 1;
  }
}

test("a link carries the setting, as twist or as joints, and nothing else of the page", () => {
  const joints = [
    [1, -2.5, 2500],
    [0, 1e-9, 2500],
  ];
  for (const setting of [SETTING, { ...SETTING, joints }]) {
    const address = linkTo(setting, "https://host/robots/?websocket=wss%3A%2F%2Fx&drive.x=9#there");
    const carried = settingOf(new URL(address).search);
    expect(carried).toEqual(setting.joints ? { ...setting, twist: carried?.twist } : setting);
    expect(address.startsWith("https://host/robots/?student=tsd&")).toBe(true);
    expect(address).not.toContain("wss");
  }
});

test("an address without a setting has none, and what is no number is left out", () => {
  expect(settingOf("?fixedDpr=0.5")).toBeNull();
  const found = settingOf("?student=kiwi&drive.a=x&drive.b=&drive.c=1e999&twist=1_2&joints=1_x");
  expect(found?.knobs).toEqual({});
  expect(found?.twist.length).toBe(3);
  expect(found?.joints).toBeNull();
});

test("one request is under way at a time, and the newest setting follows", () => {
  const model = shown();
  const [first] = link.take();
  for (const tilt of [10, 11, 12]) model.turn("drive.max_tilt_deg", tilt);
  pass(1000);
  expect(link.take()).toEqual([]);
  link.reply(first!);
  const [second] = link.take();
  expect(second?.knobs).toEqual({ "drive.max_tilt_deg": 12 });
  link.reply(second!);
  pass(1000);
  expect(link.take()).toEqual([]);
});

test("requests of a hand that keeps turning stay below the limit of the server", () => {
  const model = shown();
  let count = 0;
  for (let ms = 0; ms < 2000; ms++) {
    model.turn("drive.max_tilt_deg", ms);
    vi.advanceTimersByTime(1);
    for (const request of link.take()) {
      count += 1;
      link.reply(request);
    }
  }
  expect(count).toBeGreaterThan(10);
  expect(count).toBeLessThanOrEqual(40);
});

test("a request that is lost is sent again, also after a new connection", () => {
  shown();
  expect(link.take().length).toBe(1);
  pass(1000);
  expect(link.take()).toEqual([]);
  pass(1000);
  expect(link.take().length).toBe(1);
  link.say("welcome");
  pass(100);
  expect(link.take().length).toBe(1);
});

test("nothing is asked for while the tab is closed, and the scene gets its robot back", () => {
  const model = shown();
  link.reply(link.take()[0]!);
  pass(200);
  model.show(false);
  pass(200);
  const [last] = link.take();
  expect(last?.show).toBe(false);
  link.reply(last!);
  pass(5000);
  expect(link.take()).toEqual([]);
});

test("a knob back at its usual value, and another robot, are no changes", () => {
  const model = shown("?student=tsd&drive.max_tilt_deg=20");
  link.reply(link.take()[0]!);
  model.turn("drive.max_tilt_deg", 30);
  expect(model.setting.value.knobs).toEqual({});
  model.turn("drive.max_tilt_deg", 20);
  model.choose("kiwi");
  expect(model.setting.value.knobs).toEqual({});
});

test("a twist after joints starts from what the joints made of it", () => {
  const model = shown();
  const wheels = [{ gimbal: [1, 2, 3], rpm: 2500 }] as never;
  link.reply(link.take()[0]!, { figures: { twist: [0.3, 0.2, 0.1], wheels } as never });
  model.bend(0, 1, -4);
  expect(model.setting.value.joints).toEqual([[1, -4, 2500]]);
  model.move(2, 1);
  expect(model.setting.value).toMatchObject({ twist: [0.3, 0.2, 1], joints: null });
});

test("the file is asked for until it comes, or there is none", () => {
  for (const fields of [{ toml: "name" }, { problem: "impossible" }]) {
    link = new FakeLink();
    const model = shown();
    const [plain] = link.take();
    model.requestToml();
    link.reply(plain!);
    pass(200);
    const [asked] = link.take();
    expect(asked?.toml).toBe(true);
    link.reply(asked!, fields);
    model.move(0, 0.1);
    pass(200);
    expect(link.take()[0]?.toml).toBe(false);
  }
});

test("from above, the front of the robot is up and its left is left", () => {
  expect(fromAbove([1, 0])).toEqual([0, -1]);
  expect(fromAbove([0, 1])).toEqual([-1, 0]);
});
