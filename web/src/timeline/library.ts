// The list of recordings, fetched again when the dashboard reports a change.

import { effect, signal } from "@preact/signals";
import type { RecordingRow, TrashRow } from "../generated/wire";
import type { Link } from "../store/link";
import { answer, request } from "./request";

export type ListState = "loading" | "ready" | "absent" | "failed";

const REFRESH_MS = 1500; // Shortest time between two requests; details of many files come in quickly.
const WATCH_BEATS = 100; // Ten seconds: nothing reports the end of a recording.

/** Whether the list is shown; the timeline and the tabs of a phone open it. */
export const recordingsOpen = signal(false);

export class Library {
  readonly state = signal<ListState>("loading");
  readonly rows = signal<readonly RecordingRow[]>([]);
  readonly trash = signal<readonly TrashRow[]>([]);
  readonly query = signal("");
  /** Recording that is being written, and when its length was reported. */
  readonly written = signal<{ row: RecordingRow; atMs: number } | null>(null);
  #number = 0;
  #timer = 0;
  #fetchedMs = -Infinity;

  constructor(link: Link) {
    link.on("welcome", () => this.refresh());
    link.on("recordings_changed", () => this.refresh());
    effect(() => {
      if (link.beat.value % WATCH_BEATS === 0 && link.connected.peek()) void this.#watch();
    });
    effect(() => {
      if (recordingsOpen.value) this.refresh();
    });
  }

  /** Show the recordings that contain all words. */
  search(query: string): void {
    this.query.value = query;
    this.refresh();
  }

  refresh(): void {
    if (this.#timer !== 0) return;
    const waitMs = Math.max(0, this.#fetchedMs + REFRESH_MS - performance.now());
    const typed = recordingsOpen.peek() ? Math.min(waitMs, 200) : waitMs;
    this.#timer = window.setTimeout(() => void this.#fetch(), typed);
  }

  async #fetch(): Promise<void> {
    this.#timer = 0;
    this.#fetchedMs = performance.now();
    const number = ++this.#number;
    const query = recordingsOpen.peek() ? this.query.peek() : "";
    try {
      const response = await answer("GET", `?q=${encodeURIComponent(query)}`);
      const rows = response.status === 204 ? null : ((await response.json()) as RecordingRow[]);
      const trash = rows && recordingsOpen.peek() ? await request<TrashRow[]>("GET", "trash") : [];
      if (number !== this.#number) return; // A later request is under way.
      this.state.value = rows === null ? "absent" : "ready";
      this.rows.value = rows ?? [];
      this.trash.value = trash;
      if (query === "") this.#note(rows?.find((row) => row.writing));
    } catch {
      if (number === this.#number) this.state.value = "failed";
    }
  }

  async #watch(): Promise<void> {
    const name = this.written.peek()?.row.name;
    if (name === undefined) return;
    const rows = await request<RecordingRow[]>("GET", `?q=${encodeURIComponent(name)}`).catch(
      () => [],
    );
    this.#note(rows.find((row) => row.name === name && row.writing));
  }

  #note(row: RecordingRow | undefined): void {
    this.written.value = row ? { row, atMs: performance.now() } : null;
  }
}
