// STOP: at once, in every state, repeated until the robot confirms it.

import { effect, signal } from "@preact/signals";
import type { RobotState } from "../generated/wire";
import type { Link } from "../store/link";
import { isLatched, type Refusal, whyNotStop } from "../store/permission";

const RETRY_MS = 200;
const CONFIRM_MS = 600;
const RETRY_LIMIT_MS = 5000;
const STATES_IN_FLIGHT = 20; // One second of states.

export class Stop {
  /** Whether the robot has not confirmed a stop in time, and nobody has acknowledged that. */
  readonly unconfirmed = signal(false);
  onRefused: (refusal: Refusal) => void = () => {};
  #pending: {
    robot: string | undefined;
    sinceMs: number;
    sentMs: number;
    /** Latest state of a robot that was latched already. */
    latchedAt: number | null;
  } | null = null;

  /** `release` centres all controls. */
  constructor(
    private readonly link: Link,
    private readonly release: () => void,
  ) {
    link.on("state", (state) => {
      // Recorded states confirm nothing, and states of several robots are ambiguous.
      if (isLatched(link) && state.source === "robot" && !this.#isOld(state)) this.#confirm();
    });
    link.on("reply", ({ to, ok }) => {
      if (to === "stop" && ok) this.#confirm();
    });
    effect(() => void (link.beat.value && this.#retry()));
  }

  press(): void {
    const { link } = this;
    const refusal = whyNotStop(link);
    if (refusal !== null) {
      this.onRefused(refusal);
      return;
    }
    const nowMs = performance.now();
    const latchedAt = isLatched(link) ? (link.state.peek()?.status_seq ?? null) : null;
    this.#pending = { robot: link.robot.peek()?.id, sinceMs: nowMs, sentMs: nowMs, latchedAt };
    link.send({ t: "stop" });
    this.release();
  }

  acknowledge(): void {
    this.#pending = null;
    this.unconfirmed.value = false;
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
    if (this.#pending && this.#pending.robot === this.link.robot.peek()?.id) this.acknowledge();
  }

  #retry(): void {
    if (this.#pending === null) return;
    const nowMs = performance.now();
    const ageMs = nowMs - this.#pending.sinceMs;
    const isDue = nowMs - this.#pending.sentMs > RETRY_MS && ageMs <= RETRY_LIMIT_MS;
    if (isDue && this.link.send({ t: "stop" })) this.#pending.sentMs = nowMs;
    if (ageMs > CONFIRM_MS) this.unconfirmed.value = true;
  }
}
