// States of all robots, while somebody looks at them, and the stops asked for from here.

import { effect, type Signal, signal } from "@preact/signals";
import type { Fleet, FleetEvent, FleetRobot, Reason } from "../generated/wire";
import type { Link } from "../store/link";

const MAX_EVENTS = 12;

/** Row of a robot, with the times of its message on the clock of this page. */
export interface Row extends FleetRobot {
  seenMs: number | null;
  event: (FleetEvent & { atMs: number }) | null;
}

export interface NamedEvent {
  robot: string;
  title: string;
  operators: Record<string, string>;
  kind: string;
  why: Reason;
  atMs: number;
}

/** How far a stop has come: also `offline`, while the page has no dashboard to send it to. */
export interface Outcome {
  outcome: "sent" | "acknowledged" | "not_reached" | "offline";
  why: Reason | null;
}

type Pose = readonly [number, number, number];

export class FleetStore {
  readonly ids = signal<readonly string[]>([]);
  /** Whether the list has arrived since it was asked for. */
  readonly known = signal(false);
  readonly poses = signal<Readonly<Record<string, Pose>>>({});
  /** Latest events of all robots, newest first. */
  readonly events = signal<readonly NamedEvent[]>([]);
  /** Counts changed rows, for what depends on all of them. */
  readonly changes = signal(0);
  /** Whether STOP ALL was pressed since the page was opened. */
  readonly stoppedAll = signal(false);
  readonly #link: Link;
  readonly #rows = new Map<string, Signal<Row>>();
  readonly #outcomes = new Map<string, Signal<Outcome | null>>();

  constructor(link: Link, shown: () => boolean) {
    this.#link = link;
    link.on("fleet", (message) => this.#take(message));
    link.on("stop_result", ({ robot, outcome, why }) => {
      this.outcome(robot).value = { outcome, why };
    });
    effect(() => {
      const on = shown();
      if (link.connected.value && (on || this.known.peek())) link.send({ t: "fleet", on });
      if (!on || !link.connected.value) this.known.value = false;
    });
    effect(() => {
      if (link.connected.value) return; // No answer comes to stops sent before.
      for (const outcome of this.#outcomes.values())
        if (outcome.peek()?.outcome === "sent") outcome.value = { outcome: "offline", why: null };
    });
  }

  row(id: string): Signal<Row> | undefined {
    return this.#rows.get(id);
  }

  /** All rows now, in the order of the dashboard. */
  rows(): Row[] {
    return this.ids.value.flatMap((id) => this.#rows.get(id)?.value ?? []);
  }

  /** Latest stop of a robot that was asked for here, or null. */
  outcome(id: string): Signal<Outcome | null> {
    const known = this.#outcomes.get(id) ?? signal<Outcome | null>(null);
    this.#outcomes.set(id, known);
    return known;
  }

  stop(id: string): void {
    const sent = this.#link.send({ t: "stop", robot: id });
    this.outcome(id).value = { outcome: sent ? "sent" : "offline", why: null };
  }

  stopAll(): void {
    const sent = this.#link.send({ t: "stop", all: true });
    this.stoppedAll.value = true;
    for (const { id, source } of this.rows()) {
      if (source === "recording") continue; // Nothing moves there.
      this.outcome(id).value = { outcome: sent ? "sent" : "offline", why: null };
    }
  }

  #take({ whole, robots, poses }: Fleet): void {
    const nowMs = Date.now();
    if (whole) {
      const named = new Set(robots.map(({ id }) => id));
      for (const id of this.#rows.keys()) if (!named.has(id)) this.#rows.delete(id);
      this.events.value = [];
    }
    for (const robot of robots) this.#update(robot, nowMs);
    const ids = whole ? robots.map(({ id }) => id) : [...this.#rows.keys()];
    if (ids.join() !== this.ids.peek().join()) this.ids.value = ids;
    this.poses.value = whole ? poses : { ...this.poses.peek(), ...poses };
    this.known.value = true;
    if (robots.length > 0) this.changes.value += 1;
  }

  #update(robot: FleetRobot, nowMs: number): void {
    const { id, title, operators, event, age_s } = robot;
    const atMs = event ? nowMs - 1000 * event.age_s : 0;
    const row: Row = {
      ...robot,
      seenMs: age_s === null ? null : nowMs - 1000 * age_s,
      event: event && { ...event, atMs },
    };
    const known = this.#rows.get(id);
    if (known) known.value = row;
    else this.#rows.set(id, signal(row));
    const outcome = this.outcome(id);
    if (robot.latched === false && outcome.peek()?.outcome === "acknowledged") outcome.value = null;
    if (event) this.#log({ robot: id, title, operators, kind: event.kind, why: event.why, atMs });
  }

  #log(event: NamedEvent): void {
    const isSame = (other: NamedEvent) =>
      other.robot === event.robot &&
      other.why.code === event.why.code &&
      Math.abs(other.atMs - event.atMs) < 1000;
    const others = this.events.peek();
    if (others.some(isSame)) return;
    this.events.value = [event, ...others].sort((a, b) => b.atMs - a.atMs).slice(0, MAX_EVENTS);
  }
}

/** Keys by which the cards can be sorted. */
export const SORTINGS = ["need", "name", "driver"] as const;
export type Sorting = (typeof SORTINGS)[number];

/** Rank by what needs somebody: 0 first. */
export function need({ mode, latched, silent, requested_by, battery }: Row): number {
  if (silent) return 6;
  if (mode === "fault") return 0;
  if (latched) return 1;
  if (requested_by !== null) return 2;
  if (battery?.low) return 3;
  return mode === "driving" || mode === "stopping" ? 4 : 5;
}

/** Return ids of rows that contain `search`, sorted; equal ones keep the order of the dashboard. */
export function arranged(rows: readonly Row[], sorting: Sorting, search: string): string[] {
  const words = search.toLocaleLowerCase().split(/\s+/).filter(Boolean);
  const found = rows.filter((row) => {
    const driver = row.driver === null ? "" : (row.operators[row.driver] ?? row.driver);
    const text = `${row.title} ${row.id} ${driver} ${row.mode ?? ""}`.toLocaleLowerCase();
    return words.every((word) => text.includes(word));
  });
  const byText = (a: string, b: string) => a.localeCompare(b, undefined, { numeric: true });
  const compare = {
    need: (a: Row, b: Row) => need(a) - need(b),
    name: (a: Row, b: Row) => byText(a.title, b.title),
    driver: (a: Row, b: Row) => byText(a.driver ?? "\uffff", b.driver ?? "\uffff"),
  }[sorting];
  return [...found].sort(compare).map(({ id }) => id);
}
