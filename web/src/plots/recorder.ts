// Records the selected fields from page load or selection, even if the tab is closed.

import { signal } from "@preact/signals";
import type { RobotInfo, RobotState } from "../generated/wire";
import { STALE_MS } from "../store/freshness";
import type { Link } from "../store/link";
import { isObject, remembered } from "../store/memory";
import { jitterMs, roundTripMs } from "../store/quality";
import { PlotBuffer } from "./buffer";
import { fieldsOf, type PlotField, valueOf } from "./fields";
import { decode, encode, moved, type PlotLayout, usualLayout } from "./layout";

const RETRY_MS = 1000;

/** Layouts as text, by robot id or by name. */
type Layouts = Record<string, unknown>;

export class Recorder {
  readonly buffer = new PlotBuffer();
  readonly layout = signal<PlotLayout>({ windowS: 20, panes: [] });
  readonly known = signal<ReadonlyMap<string, PlotField>>(new Map());
  readonly saved = remembered<Layouts>("tsd-plot-layouts", {}, isObject);
  /** Right edge of the plots in robot time while they are paused, else null: now. */
  readonly endS = signal<number | null>(null);
  robot: RobotInfo | null = null;
  /** Seconds to add to robot time for time in the recording, or for the clock of this page. */
  offsetS = NaN;
  readonly #kept = remembered<Layouts>("tsd-plots", {}, isObject);
  #shared = decode(new URL(location.href).searchParams.get("plots"));
  #arrivedMs = 0;
  #cursorS = NaN;
  #soughtMs = -Infinity;

  constructor(private readonly link: Link) {
    link.on("state", (state) => this.#take(state));
    link.on("robot", (robot) => this.#begin(robot));
    link.on("cursor", ({ t_s }) => (this.#cursorS = t_s));
    link.on("past", ({ states }) => {
      this.#clear(); // The cursor of a recording has jumped.
      for (const state of states) this.#take(state);
    });
  }

  /** Names of the plotted fields; the robot may not have sent all of them yet. */
  get names(): string[] {
    return this.layout.value.panes.flat();
  }

  /** Plotted fields that the robot has. */
  get fields(): PlotField[] {
    return this.names.flatMap((name) => this.known.value.get(name) ?? []);
  }

  /** Estimated current robot time; it stops with the states. */
  nowS(): number {
    const sinceMs = this.link.recording === null ? performance.now() - this.#arrivedMs : 0;
    return this.buffer.newestS + Math.min(sinceMs, STALE_MS) / 1000;
  }

  /** Change the layout, null to the usual one; kept for this robot. */
  choose(change: Partial<PlotLayout> | null): void {
    if (this.robot === null) return;
    const layout = change ? encode({ ...this.layout.peek(), ...change }) : undefined;
    this.#kept.value = { ...this.#kept.peek(), [this.robot.id]: layout };
    this.#shared = null;
    this.#select(this.robot);
  }

  /** Move a field into a pane, or null: out of all. */
  move(name: string, to: number | null): void {
    this.choose({ panes: moved(this.layout.peek().panes, name, to) });
  }

  #select(robot: RobotInfo): void {
    this.layout.value = this.#shared ?? decode(this.#kept.peek()[robot.id]) ?? usualLayout(robot);
    this.buffer.select(this.names);
    this.#soughtMs = -Infinity;
  }

  #begin(robot: RobotInfo): void {
    if (this.robot?.id !== robot.id) this.#clear();
    this.robot = robot; // The same robot may have a new description.
    this.known.value = new Map();
    this.#select(robot);
  }

  #clear(): void {
    this.buffer.clear();
    this.endS.value = null; // It was on another clock.
  }

  #take(state: RobotState): void {
    if (this.robot === null) return;
    const link = {
      round_trip_ms: roundTripMs(this.link),
      jitter_ms: jitterMs(this.link),
      lost_percent: 100 * this.link.lost,
    };
    const sample = { ...state, link };
    this.#arrivedMs = performance.now();
    if (this.#arrivedMs - this.#soughtMs >= RETRY_MS) this.#seek(this.robot, sample);
    if (state.robot_s < this.buffer.newestS) this.#clear(); // The robot has restarted.
    const known = this.known.peek();
    this.buffer.add(state.robot_s, (name) => valueOf(known.get(name), sample));
    const clockS = this.link.recording === null ? Date.now() / 1000 : this.#cursorS;
    this.offsetS = clockS - state.robot_s;
  }

  /** Learn the fields of a state, and request those that are not in every state until they arrive. */
  #seek(robot: RobotInfo, sample: RobotState): void {
    this.#soughtMs = this.#arrivedMs;
    this.known.value = new Map([...this.known.peek(), ...fieldsOf(robot, sample)]);
    const names = this.names.filter((name) => robot.plot_fields.includes(name));
    const { plot } = sample;
    const isSent = Object.keys(plot).length === names.length && names.every((name) => name in plot);
    if (!isSent) this.link.send({ t: "plot_fields", names });
  }
}
