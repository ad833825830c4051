// The one notice below the view buttons. It is gone with its cause, or after it could be read.

import { effect, signal, untracked } from "@preact/signals";
import type { Link } from "./link";

const SHOWN_MS = 6000;
const READ_MS = 2000; // Shortest time, also if its cause is gone.

export class Notice {
  readonly text = signal<string | null>(null);
  #sinceMs = 0;
  #holds: () => boolean = () => true;

  constructor(link: Link) {
    link.on("robot", () => this.clear());
    effect(() => {
      if (link.beat.value >= 0 && this.text.value !== null) untracked(() => this.#check());
    });
  }

  /** Show `text` in place of the notice before it, while `holds` returns true. */
  say(text: string, holds: () => boolean = () => true): void {
    this.#sinceMs = performance.now();
    this.#holds = holds;
    this.text.value = text;
  }

  clear(): void {
    this.text.value = null;
  }

  #check(): void {
    const ageMs = performance.now() - this.#sinceMs;
    if (ageMs > SHOWN_MS || (ageMs > READ_MS && !this.#holds())) this.clear();
  }
}
