// Requests of the page to the robot, each until its answer; "no answer" is one too.

import { effect, signal, untracked } from "@preact/signals";
import type { PageMessage, Reason } from "../generated/wire";
import type { Link } from "./link";
import { jitterMs, roundTripMs } from "./quality";

const ANSWER_MS = 2000;
const BETWEEN_STATES_MS = 100; // Two periods of the states, as one may be lost.
const LONGEST_S = 10;

export type Request = Extract<
  PageMessage,
  { t: "lease" | "arm" | "disarm" | "reset" | "wheel_speed" }
>;

/**
 * Terms of control over the present link. A lost segment is repeated after another round trip or more,
 * which shows as jitter. If commands may be older than the robot's default, it limits its speed.
 */
export function controlTerms(link: Link): { max_age_s: number | null } {
  const tripMs = roundTripMs(link);
  if (tripMs === null) return { max_age_s: null };
  const latestMs = tripMs + Math.max(tripMs, jitterMs(link) ?? 0) + BETWEEN_STATES_MS;
  return { max_age_s: Math.min(LONGEST_S, latestMs / 1000) };
}

export class Requests {
  readonly pending = signal<Request["t"] | null>(null);
  /** Kind of the latest request, if it had no answer. */
  readonly unanswered = signal<Request["t"] | null>(null);
  /** Called with the reason, if any, when a request is refused or has no answer. */
  onFailed: (why: Reason | null) => void = () => {};
  #sentMs = 0;

  constructor(private readonly link: Link) {
    link.on("reply", ({ to, ok, why }) => {
      if (this.pending.peek() !== to) return;
      this.pending.value = null;
      if (!ok) this.onFailed(why);
    });
    link.on("robot", () => (this.pending.value = null)); // The answer is about another robot.
    effect(() => {
      if (link.beat.value >= 0 && performance.now() - this.#sentMs > ANSWER_MS)
        untracked(() => this.#giveUp());
    });
  }

  /** Send a request, which replaces a pending one. */
  send(request: Request): void {
    this.unanswered.value = null;
    this.pending.value = request.t;
    this.#sentMs = performance.now();
    if (!this.link.send(request)) this.#giveUp();
  }

  #giveUp(): void {
    if (this.pending.peek() === null) return;
    this.unanswered.value = this.pending.peek();
    this.pending.value = null;
    this.onFailed({ code: "no_answer" });
  }
}
