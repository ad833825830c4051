// STOP: at once, in every state, repeated until the robot confirms it.

import { effect, signal } from "@preact/signals";
import type { RobotState } from "../generated/wire";
import type { Link } from "../store/link";
import { isLatched, type Refusal, whyNotStop } from "../store/permission";

const RETRY_MS = 200;
const CONFIRM_MS = 600;
const RETRY_LIMIT_MS = 5000;
const STATES_IN_FLIGHT = 20; // One second of states.

interface Pending {
  robot: string | undefined;
  sinceMs: number;
  sentMs: number;
  latchedAt: number | null;
}

export class Stop {
  /** Whether the robot has not confirmed a stop in time, and nobody has acknowledged that. */
  readonly unconfirmed = signal(false);
  onRefused: (refusal: Refusal) => void = () => {};
  readonly #link: Link;
  readonly #release: () => void;
  #pending: Pending | null = null;

  /** `release` centres all controls. */
  constructor(link: Link, release: () => void) {
    this.#link = link;
    this.#release = release;
    link.on("state", (state) => this.#check(state));
    link.on("reply", ({ to, ok }) => {
      if (to === "stop" && ok) this.#confirm();
    });
    effect(() => void (link.beat.value && this.#retry()));
  }

  /** Stop the robot. */
  press(): void {
    const refusal = whyNotStop(this.#link);
    if (refusal !== null) {
      this.onRefused(refusal);
      return;
    }
    const now = performance.now();
    const before = this.#link.state.peek();
    const latchedAt = before && isLatched(this.#link) ? before.status_seq : null;
    this.#pending = {
      robot: this.#link.robot.peek()?.id,
      sinceMs: now,
      sentMs: now,
      latchedAt,
    };
    this.#link.send({ t: "stop" });
    this.#release();
  }

  acknowledge(): void {
    this.#pending = null;
    this.unconfirmed.value = false;
  }

  #check(state: RobotState): void {
    // Recorded states confirm nothing, and states of several robots are ambiguous.
    if (isLatched(this.#link) && state.source === "robot" && !this.#isOld(state)) this.#confirm();
  }

  /**
   * Whether a state may predate the stop. A robot that was already latched may have been reset
   * while its state was in flight. Its reply confirms the stop, or a state well after it.
   */
  #isOld({ status_seq: seen }: RobotState): boolean {
    const latchedAt = this.#pending?.latchedAt ?? null;
    return latchedAt !== null && seen >= latchedAt && seen - latchedAt < STATES_IN_FLIGHT;
  }

  /** Confirm the stop of the displayed robot; a stop of another robot stays pending. */
  #confirm(): void {
    if (this.#pending === null || this.#pending.robot !== this.#link.robot.peek()?.id) return;
    this.acknowledge();
  }

  #retry(): void {
    if (this.#pending === null) return;
    const now = performance.now();
    const ageMs = now - this.#pending.sinceMs;
    const isDue = now - this.#pending.sentMs > RETRY_MS && ageMs <= RETRY_LIMIT_MS;
    if (isDue && this.#link.send({ t: "stop" })) this.#pending.sentMs = now;
    if (ageMs > CONFIRM_MS) this.unconfirmed.value = true;
  }
}
