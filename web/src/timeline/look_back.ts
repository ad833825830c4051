// The last half minute of the live robot: which modes it was in, and a look at it, which sends
// nothing but `look_back` and so moves nothing.

import { signal } from "@preact/signals";
import type { PastState } from "../generated/wire";
import type { Link } from "../store/link";
import { throttled } from "./throttle";

export const BACK_S = 30;
const LEAST_S = 0.1;
const GAP_MS = 500;

export class LookBack {
  /** Age of the past state in the scene, or null. */
  readonly agoS = signal<number | null>(null);
  readonly past = signal<PastState | null>(null);
  /**
   * Modes since the page shows the robot, oldest first, with gaps where no state arrived; times are
   * on the `performance.now` clock.
   */
  readonly modes: { mode: string; fromMs: number; toMs: number }[] = [];
  readonly #send: (agoS: number | null) => void;

  constructor(link: Link) {
    this.#send = throttled((history_offset_s) => {
      if (history_offset_s === this.agoS.peek()) link.send({ t: "look_back", history_offset_s });
    });
    link.on("state", ({ past, status }) => {
      // One of an earlier request may still be in flight.
      this.past.value = past?.history_offset_s === this.agoS.peek() ? past : null;
      this.#record(status.mode, performance.now());
    });
    link.on("welcome", () => this.#end());
    link.on("robot", () => {
      this.#end(); // The dashboard has ended it as well.
      this.modes.length = 0;
    });
  }

  /** Look at the state of `agoS` ago; less than 0.1 s ago is now, and live. */
  look(agoS: number): void {
    const wanted = agoS < LEAST_S ? null : Math.min(BACK_S, Math.round(10 * agoS) / 10);
    if (wanted === this.agoS.peek()) return;
    this.agoS.value = wanted;
    this.past.value = null;
    this.#send(wanted);
  }

  #end(): void {
    this.agoS.value = this.past.value = null;
  }

  #record(mode: string, nowMs: number): void {
    const last = this.modes.at(-1);
    const isNext = last !== undefined && nowMs - last.toMs < GAP_MS;
    if (isNext) last.toMs = nowMs;
    if (!isNext || last.mode !== mode) this.modes.push({ mode, fromMs: nowMs, toMs: nowMs });
    while (this.modes[0] && this.modes[0].toMs < nowMs - 1000 * BACK_S) this.modes.shift();
  }
}
