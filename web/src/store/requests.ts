// Requests of the page to the robot, each until its answer; "no answer" is one too.

import { effect, signal } from "@preact/signals";
import type { PageMessage, Reason } from "../generated/wire";
import type { Link } from "./link";
import { roundTripMs } from "./quality";

const ANSWER_MS = 2000;

type Request = Extract<PageMessage, { t: "lease" | "arm" | "disarm" | "reset" | "wheel_speed" }>;

/** Result of a request. */
export type Outcome = { ok: true } | { ok: false; why: Reason | null } | "no_answer";

const FAR_MS = 120; // Above this round trip, commands often exceed the default age limit.

/** Terms of control over a slow link: commands may be older, so the robot limits its speed. */
export function controlTerms(link: Link): { max_age_s: number | null } {
  const tripMs = roundTripMs(link) ?? 0;
  return { max_age_s: tripMs > FAR_MS ? Math.min(10, (2 * tripMs + 100) / 1000) : null };
}

export class Requests {
  /** Pending request. */
  readonly pending = signal<{ request: Request; sinceMs: number } | null>(null);
  /** Kind of the latest request, if it had no answer. */
  readonly unanswered = signal<Request["t"] | null>(null);
  /** Called with each refusal and each request without an answer. */
  onFailed: (request: Request, outcome: Exclude<Outcome, { ok: true }>) => void = () => {};
  readonly #link: Link;

  constructor(link: Link) {
    this.#link = link;
    link.on("reply", ({ to, ok, why }) => {
      const pending = this.pending.peek();
      if (pending?.request.t === to) this.#end(ok ? { ok } : { ok, why });
    });
    link.on("robot", () => (this.pending.value = null)); // The answer is about another robot.
    effect(() => {
      const pending = link.beat.value >= 0 ? this.pending.peek() : null;
      if (pending && performance.now() - pending.sinceMs > ANSWER_MS) this.#end("no_answer");
    });
  }

  /** Send a request, which replaces a pending one. */
  send(request: Request): void {
    this.unanswered.value = null;
    this.pending.value = { request, sinceMs: performance.now() };
    if (!this.#link.send(request)) this.#end("no_answer");
  }

  isPending(kind: Request["t"]): boolean {
    return this.pending.value?.request.t === kind;
  }

  #end(outcome: Outcome): void {
    const request = this.pending.peek()?.request;
    this.pending.value = null;
    if (outcome === "no_answer") this.unanswered.value = request?.t ?? null;
    if (request && (outcome === "no_answer" || !outcome.ok)) this.onFailed(request, outcome);
  }
}
