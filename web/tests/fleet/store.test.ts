import { signal } from "@preact/signals";
import { beforeEach, describe, expect, test } from "vitest";

import { fitted } from "../../src/fleet/fleet";
import { arranged, FleetStore, need, type Row } from "../../src/fleet/store";
import type { FleetRobot, PageMessage } from "../../src/generated/wire";
import type { Link } from "../../src/store/link";

const ROBOT: FleetRobot = {
  id: "tsd",
  title: "tsd",
  colour: "#1d96fe",
  panel: "gimbals",
  wheel_count: 3,
  space: "floor",
  source: "robot",
  silent: false,
  age_s: 0,
  mode: "ready",
  latched: false,
  why: null,
  driver: null,
  requested_by: null,
  operators: {},
  battery: null,
  event: null,
};

function row(change: Partial<Row>): Row {
  return { ...ROBOT, seenMs: 0, event: null, ...change } as Row;
}

/** Link whose messages the test makes up. */
class FakeLink {
  readonly connected = signal(true);
  readonly sent: PageMessage[] = [];
  works = true;
  #listeners = new Map<string, (message: never) => void>();

  on(kind: string, listener: (message: never) => void): () => void {
    this.#listeners.set(kind, listener);
    return () => {};
  }

  send(message: PageMessage): boolean {
    if (this.works) this.sent.push(message);
    return this.works;
  }

  receive(message: { t: string }): void {
    this.#listeners.get(message.t)?.(message as never);
  }
}

let link: FakeLink;
let store: FleetStore;
const shown = signal(true);

function fleet(robots: FleetRobot[], whole = true): void {
  link.receive({ t: "fleet", whole, robots, poses: {} } as never);
}

beforeEach(() => {
  shown.value = true;
  link = new FakeLink();
  store = new FleetStore(link as unknown as Link, () => shown.value);
});

test("the list is asked for while it is shown, and again after a reconnection", () => {
  fleet([ROBOT]);
  link.connected.value = false;
  expect(store.known.value).toBe(false);
  link.connected.value = true;
  fleet([ROBOT]);
  shown.value = false;
  const asked = link.sent.filter(({ t }) => t === "fleet").map((each) => "on" in each && each.on);
  expect(asked).toEqual([true, true, false]);
});

test("a partial message keeps the other robots, a whole one does not", () => {
  fleet([ROBOT, { ...ROBOT, id: "kiwi" }]);
  fleet([{ ...ROBOT, id: "kiwi", mode: "fault" }], false);
  expect(store.rows.value.map(({ id }) => id)).toEqual(["tsd", "kiwi"]);
  expect(store.rows.value.map(({ mode }) => mode)).toEqual(["ready", "fault"]);
  fleet([ROBOT]);
  expect(store.rows.value.map(({ id }) => id)).toEqual(["tsd"]);
});

describe("stops", () => {
  test("one robot is stopped by its id, and its answer is kept", () => {
    fleet([ROBOT, { ...ROBOT, id: "kiwi" }]);
    store.stop("kiwi");
    expect(link.sent.at(-1)).toEqual({ t: "stop", robot: "kiwi" });
    expect(store.outcomes.value["kiwi"]).toBe("sent");
    link.receive({ t: "stop_result", robot: "kiwi", outcome: "not_reached", why: null } as never);
    expect(store.outcomes.value["kiwi"]).toBe("not_reached");
    expect(store.outcomes.value["tsd"] ?? null).toBe(null);
  });

  test("all robots are stopped at once, silent ones too, but no recording", () => {
    const recording = { ...ROBOT, id: "old", source: "recording" } as const;
    fleet([ROBOT, { ...ROBOT, id: "far", silent: true }, recording]);
    store.stopAll();
    expect(link.sent.at(-1)).toEqual({ t: "stop", all: true });
    expect(store.outcomes.value["far"]).toBe("sent");
    expect(store.outcomes.value["old"] ?? null).toBe(null);
  });

  test("without a dashboard, the page does not claim that a stop was sent", () => {
    fleet([ROBOT]);
    link.works = false;
    store.stop("tsd");
    expect(store.outcomes.value["tsd"]).toBe("offline");
    store.stopAll();
    expect(store.outcomes.value["tsd"]).toBe("offline");
  });

  test("a stop whose answer is lost with the connection is not shown as under way", () => {
    fleet([ROBOT]);
    store.stop("tsd");
    link.connected.value = false;
    expect(store.outcomes.value["tsd"]).toBe("offline");
  });

  test("a confirmed stop is forgotten once the robot was reset", () => {
    fleet([ROBOT]);
    store.stop("tsd");
    link.receive({ t: "stop_result", robot: "tsd", outcome: "acknowledged", why: null } as never);
    fleet([{ ...ROBOT, latched: true, mode: "stopped" }], false);
    expect(store.outcomes.value["tsd"]).toBe("acknowledged");
    fleet([ROBOT], false);
    expect(store.outcomes.value["tsd"] ?? null).toBe(null);
  });
});

test("robots that need somebody come first, and equal ones keep their order", () => {
  const rows = [
    row({ id: "gone", silent: true, mode: "fault" }),
    row({ id: "ready" }),
    row({ id: "drives", mode: "driving" }),
    row({ id: "ready too" }),
    row({ id: "stopped", mode: "stopped", latched: true }),
    row({ id: "fault", mode: "fault", latched: true }),
    row({ id: "asked", requested_by: "bob" }),
  ];
  const order = arranged(rows, "");
  expect(order).toEqual(["fault", "stopped", "asked", "drives", "ready", "ready too", "gone"]);
  const needs = order.map((id) => need(rows.find((each) => each.id === id)!));
  expect(needs).toEqual([...needs].sort());
});

test("the search finds all words, in names, drivers and modes", () => {
  const bob = row({ id: "tsd", driver: "bob-1", operators: { "bob-1": "Bob Lindqvist" } });
  const kiwi = row({ id: "kiwi", title: "Kiwi", mode: "fault" });
  expect(arranged([bob, kiwi], "lind TSD")).toEqual(["tsd"]);
  expect(arranged([bob, kiwi], "fault")).toEqual(["kiwi"]);
  expect(arranged([bob, kiwi], "fault lind")).toEqual([]);
});

test("every robot lies inside the floor map, with x up and y to the left", () => {
  for (let i = 0; i < 200; i++) {
    const random = () => 200 * (Math.random() - 0.5);
    const poses = Array.from(
      { length: 20 },
      () => [random(), random(), 0] as [number, number, number],
    );
    const { place } = fitted(poses);
    for (const pose of poses) {
      const { right, down } = place(pose);
      expect(Math.min(right, down)).toBeGreaterThan(0);
      expect(Math.max(right, down)).toBeLessThan(360);
    }
    expect(place([1, 0, 0]).down).toBeLessThan(place([0, 0, 0]).down);
    expect(place([0, 1, 0]).right).toBeLessThan(place([0, 0, 0]).right);
  }
});
