// Planned path: chosen on the floor, checked, then followed while a hand holds it. The server plans
// and controls; the page only reports that it is held, and release stops the robot.

import { computed, effect, signal, untracked } from "@preact/signals";
import type { FollowPlan, PlanRequest, RouteState } from "../generated/wire";
import type { Link } from "../store/link";
import { codeOf, isLatched, type Refusal, whyNotDrive, whyNotPlan } from "../store/permission";
import { isOnFloor } from "./axes";
import type { Drive, Source } from "./drive";
import { HeldKeys } from "./held";
import type { Keyboard } from "./keyboard";

/** How the robot is driven: by the controls, to a point, or along a drawn line. */
export type PathMode = "stick" | "to" | "draw";

/** What is to be planned; the path adds the speed level. */
export type Wish = Omit<PlanRequest, "t" | "level">;

const KEY = "KeyG";

export class Path implements Source {
  readonly mode = signal<PathMode>("stick");
  /** Whether it is held, so that the robot follows it. */
  readonly going = signal(false);
  /** What was last asked for, until its path has ended or is cleared. */
  readonly wish = signal<Wish | null>(null);
  readonly route = computed(() => this.#link.state.value?.route ?? null);
  /** Whether a path is the next thing to drive, in place of the stick. */
  readonly offered = computed(
    () => this.mode.value !== "stick" || (this.route.value !== null && !isOver(this.route.value)),
  );
  /** Called with each refusal, and whether it still holds. */
  onRefused: (refusal: Refusal, holds: () => boolean) => void = () => {};

  readonly #link: Link;
  readonly #drive: Drive;
  readonly #keys = new HeldKeys();
  #number: number | null = null; // Of the held path.
  #end = ""; // The end that has been handled: of a path, or a stop.

  constructor(link: Link, drive: Drive, keyboard: Keyboard) {
    this.#link = link;
    this.#drive = drive;
    drive.add(this);
    keyboard.bind(
      KEY,
      (key) => this.#keys.take(key) && this.#holdByKey(),
      (key) => this.#keys.take(key) && this.letGo(),
    );
    // After the dialogs and menus, which keep their Escape.
    addEventListener("keydown", ({ code, repeat }) => {
      if (code === "Escape" && !repeat && this.offered.peek()) this.clear();
    });
    link.on("state", () => this.#check());
    link.on("robot", () => this.choose("stick"));
    link.on("reply", ({ to, ok, why }) => {
      if (to !== "plan" || ok) return;
      this.wish.value = null;
      if (why) this.onRefused({ by: "robot", reason: why }, () => true);
    });
    let level = drive.level.peek();
    effect(() => {
      if (drive.level.value === level) return;
      level = drive.level.value;
      if (untracked(() => this.route.value) !== null)
        link.send({ t: "speed_level", level: percent(level) });
    });
  }

  get held(): boolean {
    return this.going.peek();
  }

  /** Null while nothing is held; any hand control ends it. */
  get follow(): Omit<FollowPlan, "status_seq"> | null {
    return this.#number === null ? null : { t: "follow_plan", route: this.#number };
  }

  choose(mode: PathMode): void {
    this.mode.value = mode;
    if (mode === "stick") this.wish.value = null;
  }

  /** Ask for a path; nothing moves. */
  plan(wish: Wish): void {
    const refusal = untracked(() => whyNotPlan(this.#link));
    if (refusal === null) {
      this.wish.value = wish;
      this.#link.send({ t: "plan", ...wish, level: percent(this.#drive.level.peek()) });
      return;
    }
    if (this.route.peek() !== null) this.#link.send({ t: "clear_plan" }); // It is not wanted now.
    this.#refuse(refusal, () => whyNotPlan(this.#link));
  }

  /** Discard the path and return to the stick. */
  clear(): void {
    if (this.held) this.#drive.release();
    this.#link.send({ t: "clear_plan" });
    this.choose("stick");
  }

  /** Why the path cannot be followed now, or null. */
  whyNotGo(): Refusal | null {
    const refusal = whyNotDrive(this.#link);
    if (refusal !== null || this.going.value) return refusal;
    if (this.#drive.held.value || this.#link.state.value?.status.mode === "driving")
      return { by: "page", code: "still_moves" };
    return this.route.value?.phase === "planned" ? null : { by: "page", code: "no_path" };
  }

  /** Follow the path from now on, until `letGo`; return whether it is followed. */
  hold(): boolean {
    if (this.held) return true;
    const refusal = untracked(() => this.whyNotGo());
    if (refusal !== null) {
      this.#refuse(refusal, () => this.whyNotGo());
      return false;
    }
    this.#number = this.route.peek()?.number ?? null;
    this.going.value = this.#number !== null;
    // The camera moves with the robot, so points of the picture lose their places.
    if (this.wish.peek()?.on === "picture") this.wish.value = null;
    this.#drive.changed();
    return this.held;
  }

  /** Release the path: the robot stops. */
  letGo(): void {
    if (!this.held) return;
    this.cancel();
    this.#drive.changed();
  }

  cancel(): void {
    this.#keys.cancel();
    this.#number = null;
    this.going.value = false;
  }

  #holdByKey(): void {
    if (!this.offered.peek() || !this.hold()) this.#keys.cancel();
  }

  #refuse(refusal: Refusal, again: () => Refusal | null): void {
    this.onRefused(refusal, () => {
      const now = again();
      return now !== null && codeOf(now) === codeOf(refusal);
    });
  }

  /** End what the state has ended: a lost path, control of the robot, the choice of a place. */
  #check(): void {
    const route = this.route.peek();
    const lost = route === null || route.number !== this.#number || route.phase === "arrived";
    if (this.held && lost) {
      this.cancel();
      this.#drive.changed();
    }
    const link = this.#link;
    const end = untracked(() =>
      isLatched(link) ? "stop" : route && isOver(route) ? `path ${route.number}` : "",
    );
    const state = link.state.peek();
    const barred = !state?.has_control || !isOnFloor(link.robot.peek());
    if ((end !== "" && end !== this.#end) || barred) this.choose("stick");
    this.#end = end;
  }
}

/** Whether a path has ended, at its goal or not. */
export function isOver({ phase }: RouteState): boolean {
  return phase === "arrived" || phase === "ended";
}

/** Level of a message, from 1 to 100. */
function percent(level: number): number {
  return Math.max(1, Math.min(100, Math.round(100 * level)));
}
