// States of all robots while the page shows them, and the stops that it has requested.

import { effect, signal } from "@preact/signals";
import type * as wire from "../generated/wire";
import type { Link } from "../store/link";

const MAX_EVENTS = 12;
const SAME_EVENT_MS = 1000; // Two messages about an event differ by less in its age.

/** A robot, with the times of its message on the clock of this page. */
export interface Row extends wire.FleetRobot {
  seenMs: number | null;
  event: (wire.FleetEvent & { atMs: number }) | null;
}

/** How far a stop has come; `offline`: the page has no dashboard to send it to. */
export type Outcome = wire.StopResult["outcome"] | "offline";

export class FleetStore {
  /** All robots, in the order of the dashboard. */
  readonly rows = signal<readonly Row[]>([]);
  /** Whether the list has arrived since it was requested. */
  readonly known = signal(false);
  readonly poses = signal<wire.Fleet["poses"]>({});
  /** Robots as they were when something happened, latest first. */
  readonly events = signal<readonly Row[]>([]);
  /** Latest stops requested here, by robot. */
  readonly outcomes = signal<Readonly<Record<string, Outcome | null>>>({});
  /** Why the latest stop did not reach a robot, by robot. */
  readonly missed = signal<Readonly<Record<string, wire.Reason | null>>>({});
  /** Whether STOP ALL was pressed since the page was opened. */
  readonly stoppedAll = signal(false);

  constructor(
    private readonly link: Link,
    shown: () => boolean,
  ) {
    link.on("fleet", (message) => this.#take(message));
    link.on("stop_result", ({ robot, outcome, why }) => this.#note(robot, outcome, why));
    effect(() => {
      const on = shown();
      if (link.connected.value && (on || this.known.peek())) link.send({ t: "fleet", on });
      if (!on || !link.connected.value) this.known.value = false;
    });
    effect(() => {
      if (link.connected.value) return; // No answer comes to stops sent before.
      for (const [id, outcome] of Object.entries(this.outcomes.peek()))
        if (outcome === "sent") this.#note(id, "offline");
    });
  }

  stop(id: string): void {
    this.#note(id, this.#sent({ t: "stop", robot: id }));
  }

  stopAll(): void {
    const outcome = this.#sent({ t: "stop", all: true });
    for (const { id, source } of this.rows.peek())
      if (source !== "recording") this.#note(id, outcome); // Nothing moves there.
    this.stoppedAll.value = true;
  }

  #sent(stop: wire.StopCommand): Outcome {
    return this.link.send(stop) ? "sent" : "offline";
  }

  #note(id: string, outcome: Outcome | null, why: wire.Reason | null = null): void {
    this.missed.value = { ...this.missed.peek(), [id]: why };
    this.outcomes.value = { ...this.outcomes.peek(), [id]: outcome };
  }

  #take({ whole, robots, poses }: wire.Fleet): void {
    const rows = new Map(whole ? [] : this.rows.peek().map((row) => [row.id, row]));
    const heard = robots.map(timed);
    const happened = heard.filter((row) => isNews(row, rows.get(row.id)));
    for (const row of heard) rows.set(row.id, row);
    this.rows.value = [...rows.values()];
    this.events.value = [...happened, ...(whole ? [] : this.events.peek())]
      .sort((a, b) => b.event!.atMs - a.event!.atMs)
      .slice(0, MAX_EVENTS);
    this.poses.value = whole ? poses : { ...this.poses.peek(), ...poses };
    // A robot that was reset needs no answer to its last stop.
    for (const { id, latched } of heard)
      if (!latched && this.outcomes.peek()[id] === "acknowledged") this.#note(id, null);
    this.known.value = true;
  }
}

function timed(robot: wire.FleetRobot): Row {
  const ago = (ageS: number) => Date.now() - 1000 * ageS;
  const { age_s, event } = robot;
  return {
    ...robot,
    seenMs: age_s === null ? null : ago(age_s),
    event: event && { ...event, atMs: ago(event.age_s) },
  };
}

function isNews({ event }: Row, before: Row | undefined): boolean {
  if (event === null || !before?.event) return event !== null;
  const isOther = event.why.code !== before.event.why.code;
  return isOther || Math.abs(event.atMs - before.event.atMs) >= SAME_EVENT_MS;
}

/** Rank by urgency; 0 is first. */
export function need({ mode, latched, silent, requested_by, battery }: Row): number {
  if (silent) return 6;
  if (mode === "fault") return 0;
  if (latched) return 1;
  if (requested_by !== null) return 2;
  if (battery?.low) return 3;
  return mode === "driving" || mode === "stopping" ? 4 : 5;
}

/** Return ids of rows with all words of `search`, by need; equal ones keep their order. */
export function arranged(rows: readonly Row[], search: string): string[] {
  const words = search.toLocaleLowerCase().split(/\s+/);
  const found = rows.filter((row) => {
    const driver = row.driver === null ? "" : (row.operators[row.driver] ?? row.driver);
    const text = `${row.title} ${row.id} ${driver} ${row.mode ?? ""}`.toLocaleLowerCase();
    return words.every((word) => text.includes(word));
  });
  return found.sort((a, b) => need(a) - need(b)).map(({ id }) => id);
}
