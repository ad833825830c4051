// Playback of the recording that this page shows.

import { computed, signal } from "@preact/signals";
import type { Cursor, RecordedLanes, Timeline, TimelineEvent } from "../generated/wire";
import type { Link } from "../store/link";
import { request } from "./library";
import { throttled } from "./throttle";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
const NEAR_S = 0.05;
const GROWN_S = 10; // Lanes of a recording that grows are read again after this time.

/** Return the next event after a time, or the previous one before it. */
export function eventFrom(events: readonly TimelineEvent[], tS: number, way: 1 | -1) {
  return way > 0
    ? events.find(({ t_s }) => t_s > tS + NEAR_S)
    : events.findLast(({ t_s }) => t_s < tS - NEAR_S);
}

export class Playback {
  /** With its events in order of time. */
  readonly timeline = signal<Timeline | null>(null);
  readonly cursor = signal<Cursor>({ t: "cursor", t_s: 0, playing: false, speed: 1 });
  /** Speed at which it plays, or will. */
  readonly speed = signal(1);
  /** Empty if the file is damaged, for example; events and cursor remain. */
  readonly lanes = signal<readonly RecordedLanes[]>([]);
  /** Wall-clock time that is shown, or null before the recording is open. */
  readonly shownMs = computed(() => {
    const timeline = this.timeline.value;
    return timeline && timeline.start_ms + 1000 * this.cursor.value.t_s;
  });
  readonly #seek: (tS: number) => void;
  #seekS = Number(new URL(location.href).searchParams.get("t") ?? NaN);

  constructor(private readonly link: Link) {
    this.#seek = throttled((t_s) => link.send({ t: "seek", t_s }));
    link.on("welcome", () => {
      if (this.timeline.peek() !== null) this.#seekS = this.cursor.peek().t_s; // Connected again.
    });
    link.on("timeline", (timeline) => this.#take(timeline));
    link.on("cursor", (cursor) => {
      this.cursor.value = cursor;
      if (cursor.playing) this.speed.value = cursor.speed;
    });
  }

  seek(tS: number): void {
    this.#seek(Math.max(0, Math.min(this.timeline.peek()?.duration_s ?? 0, tS)));
  }

  toggle(): void {
    const { playing } = this.cursor.peek();
    this.link.send(playing ? { t: "pause" } : { t: "play", speed: this.speed.peek() });
  }

  setSpeed(speed: number): void {
    this.speed.value = speed;
    if (this.cursor.peek().playing) this.link.send({ t: "play", speed });
  }

  jump(way: 1 | -1): void {
    const event = eventFrom(this.timeline.peek()?.events ?? [], this.cursor.peek().t_s, way);
    if (event !== undefined) this.seek(event.t_s);
  }

  #take(timeline: Timeline): void {
    const events = [...timeline.events].sort((one, other) => one.t_s - other.t_s);
    this.timeline.value = { ...timeline, events };
    if (!Number.isNaN(this.#seekS)) this.seek(this.#seekS);
    this.#seekS = NaN;
    const known = this.lanes.peek()[0]?.end_s ?? -Infinity;
    if (timeline.duration_s > known + GROWN_S) void this.#readLanes(timeline.name);
  }

  async #readLanes(name: string): Promise<void> {
    const path = `recordings/${encodeURIComponent(name)}/lanes`;
    this.lanes.value = await request<RecordedLanes[]>("GET", path).catch(() => []);
  }
}
