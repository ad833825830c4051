// Planned path: chosen on the floor, checked, then followed while a hand holds it. The server plans
// and controls; the page only reports that it is held, and release stops the robot.

import { computed, effect, signal, untracked } from "@preact/signals";
import type { FollowPlan, PlanRequest, RouteState } from "../generated/wire";
import type { Link } from "../store/link";
import { stillHolds, isLatched, type Refusal, whyNotDrive, whyNotPlan } from "../store/permission";
import { isOnFloor } from "./axes";
import type { Drive, Source } from "./drive";
import { HeldKeys } from "./held";
import type { Key, Keyboard } from "./keyboard";
import type { Holder, SprungControl } from "./sprung";

/** How the robot is driven: by the controls, to a point, or along a drawn line. */
export type PathMode = "stick" | "to" | "draw";

/** Request to plan; the path adds the speed level. */
export type Wish = Omit<PlanRequest, "t" | "level">;

const percent = (level: number): number => Math.round(100 * level);

export class Path implements Source, Holder {
  readonly mode = signal<PathMode>("stick");
  /** Whether it is held, so that the robot follows it. */
  readonly going = signal(false);
  /** Last request, until its path has ended or is cleared. */
  readonly wish = signal<Wish | null>(null);
  readonly route = computed(() => this.link.state.value?.route ?? null);
  /** Whether a path is the next thing to drive, in place of the stick. */
  readonly offered = computed(
    () => this.mode.value !== "stick" || (this.route.value !== null && !isOver(this.route.value)),
  );
  /** Called with each refusal, and whether it still holds. */
  onRefused: (refusal: Refusal, holds: () => boolean) => void = () => {};

  readonly #keys = new HeldKeys(); // The key G, anywhere on the page.
  readonly #controls = new Set<SprungControl>();
  #number = 0; // Number of the held path.
  #end = ""; // End of a path, or stop, that has been handled.

  constructor(
    private readonly link: Link,
    private readonly drive: Drive,
    keyboard: Keyboard,
  ) {
    drive.add(this);
    const press = (key: Key) => {
      if (this.#keys.take(key) && !(this.offered.peek() && this.hold())) this.#keys.cancel();
    };
    keyboard.bind({ KeyG: press }, (key) => this.#keys.take(key) && this.letGo());
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
    let before = drive.level.peek();
    effect(() => {
      const level = drive.level.value;
      if (level !== before && untracked(() => this.route.value) !== null)
        link.send({ t: "speed_level", level: percent(level) });
      before = level;
    });
  }

  get held(): boolean {
    return this.going.peek();
  }

  /** Null while nothing is held; any hand control ends it. */
  get follow(): Omit<FollowPlan, "status_seq"> | null {
    return this.held ? { t: "follow_plan", route: this.#number } : null;
  }

  choose(mode: PathMode): void {
    this.mode.value = mode;
    if (mode === "stick") this.wish.value = null;
  }

  /** Ask for a path; nothing moves. */
  plan(wish: Wish): void {
    if (this.#may(() => whyNotPlan(this.link))) {
      this.wish.value = wish;
      this.link.send({ t: "plan", ...wish, level: percent(this.drive.level.peek()) });
    } else if (this.route.peek() !== null) this.link.send({ t: "clear_plan" }); // Not wanted now.
  }

  clear(): void {
    if (this.held) this.drive.release();
    this.link.send({ t: "clear_plan" });
    this.choose("stick");
  }

  whyNotGo(): Refusal | null {
    const refusal = whyNotDrive(this.link);
    if (refusal !== null || this.going.value) return refusal;
    if (this.drive.held.value || this.link.state.value?.status.mode === "driving")
      return { by: "page", code: "still_moves" };
    return this.route.value?.phase === "planned" ? null : { by: "page", code: "no_path" };
  }

  /** Add a control that holds the path; returns a function that removes it. */
  add(control: SprungControl): () => void {
    this.#controls.add(control);
    return () => {
      control.cancel();
      this.#controls.delete(control);
      this.changed();
    };
  }

  changed(): void {
    if (![...this.#controls].some(({ held }) => held)) this.letGo();
    else if (!this.hold()) this.cancel();
  }

  /** Follow the path until `letGo`; return whether it is followed. */
  hold(): boolean {
    if (this.held) return true;
    if (!this.#may(() => this.whyNotGo())) return false;
    this.#number = this.route.peek()?.number ?? 0;
    this.going.value = true;
    // The camera moves with the robot, so points of the picture lose their places.
    if (this.wish.peek()?.on === "picture") this.wish.value = null;
    this.drive.changed();
    return this.held;
  }

  /** Release the path: the robot stops. */
  letGo(): void {
    if (!this.held) return;
    this.cancel();
    this.drive.changed();
  }

  cancel(): void {
    this.#keys.cancel();
    for (const control of this.#controls) control.cancel();
    this.going.value = false;
  }

  /** Return whether nothing refuses it; else tell why. */
  #may(check: () => Refusal | null): boolean {
    const refusal = untracked(check);
    if (refusal !== null) this.onRefused(refusal, () => stillHolds(refusal, check()));
    return refusal === null;
  }

  /** End what the state has ended: a lost path, control of the robot, the choice of a place. */
  #check(): void {
    const route = this.route.peek();
    if (route?.number !== this.#number || route.phase === "arrived") this.letGo();
    const { link } = this;
    const over = route && isOver(route) ? `path ${route.number}` : "";
    const end = untracked(() => isLatched(link)) ? "stop" : over;
    const barred = !link.state.peek()?.has_control || !isOnFloor(link.robot.peek());
    if ((end !== "" && end !== this.#end) || barred) this.choose("stick");
    this.#end = end;
  }
}

export function isOver({ phase }: RouteState): boolean {
  return phase === "arrived" || phase === "ended";
}
