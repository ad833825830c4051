// The list of recordings, fetched again when the dashboard reports a change; their addresses, and
// requests about them.

import { effect, signal } from "@preact/signals";
import type { RecordingRow, TrashRow } from "../generated/wire";
import type { Link } from "../store/link";
import { texts } from "../text/text";
import { copyText } from "../ui/share";

const WAIT_MS = { open: 300, closed: 1500 }; // Details of many files come in quickly.
const WATCH_BEATS = 100; // Ten seconds: nothing reports the end of a recording.
const MISSING_BEATS = 20;
/** Refusals without a body, as of HEAD or by a proxy. */
const CODES: Record<number, string> = { 403: "viewer", 404: "no_recording", 429: "too_many" };

interface List {
  state: "loading" | "ready" | "absent" | "failed";
  rows: readonly RecordingRow[];
  trash: readonly TrashRow[];
}

export class Library {
  readonly open = signal(false);
  readonly list = signal<List>({ state: "loading", rows: [], trash: [] });
  /** Words that all recordings in the list contain. */
  readonly query = signal("");
  /** Recording that is being written, and when its length was reported. */
  readonly written = signal<{ row: RecordingRow; atMs: number } | null>(null);
  /** Whether the recording of this page does not exist, so that its socket is refused. */
  readonly isMissing = signal(false);
  #number = 0;
  #timer = 0;

  constructor(link: Link) {
    link.on("welcome", () => this.refresh());
    link.on("recordings_changed", () => this.refresh());
    effect(() => {
      if (link.beat.value % WATCH_BEATS === 0 && link.connected.peek()) void this.#watch();
    });
    effect(() => {
      if (link.connected.value) this.isMissing.value = false;
      else if (link.beat.value % MISSING_BEATS === 1) void this.#find(link.recording);
    });
    effect(() => {
      void this.query.value;
      if (this.open.value) this.refresh();
    });
  }

  refresh(): void {
    const waitMs = WAIT_MS[this.open.peek() ? "open" : "closed"];
    this.#timer ||= window.setTimeout(() => void this.#fetch(), waitMs);
  }

  async #fetch(): Promise<void> {
    this.#timer = 0;
    const number = ++this.#number;
    const isOpen = this.open.peek();
    const query = isOpen ? this.query.peek() : "";
    try {
      const found = await answer("GET", `recordings?q=${encodeURIComponent(query)}`);
      const rows = found.status === 204 ? null : ((await found.json()) as RecordingRow[]);
      const trash = rows && isOpen ? await request<TrashRow[]>("GET", "recordings/trash") : [];
      if (number !== this.#number) return; // A later request is pending.
      this.list.value = { state: rows ? "ready" : "absent", rows: rows ?? [], trash };
      if (query === "") this.#note(rows ?? []);
    } catch {
      if (number === this.#number) this.list.value = { ...this.list.peek(), state: "failed" };
    }
  }

  async #watch(): Promise<void> {
    const name = this.written.peek()?.row.name;
    if (name === undefined) return;
    const path = `recordings?q=${encodeURIComponent(name)}`;
    this.#note(await request<RecordingRow[]>("GET", path).catch(() => []));
  }

  async #find(recording: string | null): Promise<void> {
    if (recording === null) return;
    const path = `recordings/${encodeURIComponent(recording)}/path`;
    const found = await fetch(new URL(path, document.baseURI)).catch(() => null);
    this.isMissing.value = found?.status === 404;
  }

  #note(rows: readonly RecordingRow[]): void {
    const row = rows.find(({ writing }) => writing);
    this.written.value = row ? { row, atMs: performance.now() } : null;
  }
}

/** Send a request; return the answer, or throw an error whose message is a sentence. */
export async function answer(method: string, path: string, body?: unknown): Promise<Response> {
  const init = { method, body: body === undefined ? null : JSON.stringify(body) };
  const found = await fetch(new URL(path, document.baseURI), init).catch(() => null);
  if (found?.ok) return found;
  const { code, text } = ((await found?.json().catch(() => null)) ?? {}) as Record<string, string>;
  const known = texts().timeline.refusals;
  const why = known[code ?? CODES[found?.status ?? 0] ?? ""] ?? (text || known["offline"]!);
  throw new Error(why.slice(0, 1).toUpperCase() + why.slice(1).replace(/([^.!?])$/, "$1."));
}

export async function request<T>(method: string, path: string, body?: unknown): Promise<T> {
  return (await (await answer(method, path, body)).json()) as T;
}

/**
 * Address of a recording, optionally at a time in seconds since its start; null is the live page. A
 * page load, so that nothing held is sent.
 */
export function addressOf(name: string | null, tS?: number): URL {
  const address = new URL(location.href);
  for (const key of ["recording", "t"]) address.searchParams.delete(key);
  if (name !== null) address.searchParams.set("recording", name);
  if (tS !== undefined) address.searchParams.set("t", tS.toFixed(1));
  return address;
}

/** Leave the recording; no control moves a robot after it. */
export function backToLive(): void {
  location.assign(addressOf(null));
}

/** Copy the address of a recording, and return a message about that. */
export async function shared(name: string, tS?: number): Promise<string> {
  const { copied, copyYourself } = texts().timeline;
  const { href } = addressOf(name, tS);
  return (await copyText(href)) ? copied : `${copyYourself} ${href}`;
}
