// Requests of the page to the robot, each until its answer; "no answer" is one too.

import { effect, signal, untracked } from "@preact/signals";
import type { PageMessage, Reason } from "../generated/wire";
import type { Link } from "./link";
import { roundTripMs } from "./quality";

const ANSWER_MS = 2000;
const FAR_MS = 120; // Above this round trip, commands often exceed the default age limit.

export type Request = Extract<
  PageMessage,
  { t: "lease" | "arm" | "disarm" | "reset" | "wheel_speed" }
>;

/** Terms of control over a slow link: commands may be older, so the robot limits its speed. */
export function controlTerms(link: Link): { max_age_s: number | null } {
  const tripMs = roundTripMs(link) ?? 0;
  return { max_age_s: tripMs > FAR_MS ? Math.min(10, (2 * tripMs + 100) / 1000) : null };
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
