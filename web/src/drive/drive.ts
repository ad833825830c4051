// The one command of the page: what all controls ask for together, sent while something is held.

import { batch, computed, effect, signal, untracked } from "@preact/signals";
import type { FollowPlan, Reason, RobotState } from "../generated/wire";
import { freshness } from "../store/freshness";
import type { Link } from "../store/link";
import { codeOf, isLatched, type Refusal, whyNotDrive } from "../store/permission";
import {
  CENTRED,
  type Deflection,
  deflectionOf,
  limited,
  rotated,
  type Twist,
  twistOf,
} from "./axes";

/** A control that moves the robot: stick, slider, keys, gamepad. It acts only while held. */
export interface Source {
  readonly held: boolean;
  /** Fractions of the speed limit that the operator has chosen. */
  readonly share?: Deflection;
  /** Metres and radians per second. */
  readonly speed?: Deflection;
  /** Instead of a twist: follow a planned path. */
  readonly follow?: Omit<FollowPlan, "status_seq"> | null;
  /** Whether it acts on the picture only. */
  readonly looksOnly?: boolean;
  /** Whether nobody has a hand on it: any other input ends it. */
  readonly alone?: boolean;
  /** Centre it; it acts again only after it was released and taken again. */
  cancel(): void;
}

/** Why a motion ended although a control was held, or did not begin at all. */
export type Ended = { refusal: Refusal; atStart: boolean } | { released: Reason } | { lost: true };

const PERIOD_MS = 20;
const MIN_SEND_INTERVAL_MS = 9.5; // Timers may fire a few tenths of a millisecond early.

export class Drive {
  /** Speed limit of the operator: a fraction of the limits of the robot. */
  readonly level = signal(0.5);
  /** Axes of the controls. */
  readonly frame = signal<"base_link" | "odom">("base_link");
  /** Deflection that all controls ask for, m/s and rad/s along the axes of the controls. */
  readonly asked = signal<Deflection>(CENTRED);
  /** Whether the asked motion is only looked at. */
  readonly looksOnly = signal(false);
  /** Whether a control drives on with no hand on it. */
  readonly alone = signal(false);
  readonly held = signal(false);
  /** Speed of a full deflection, m/s and rad/s (rad/s twice for a sphere). */
  readonly scale = computed(() => {
    const limits = this.link.state.value?.status.limits;
    const unit_m = this.link.robot.value?.twist_scale_m ?? 1;
    const level = this.level.value;
    return {
      speed: (level * (limits?.speed_mps ?? 0)) / unit_m,
      turn: level * (limits?.turn_rate_rad_per_s ?? 0),
    };
  });
  /** Called when a motion has ended although a control was held. */
  onEnded: (ended: Ended) => void = () => {};

  readonly link: Link;
  #sources: Source[] = [];
  #timer: ReturnType<typeof setInterval> | 0 = 0; // Zero while nothing is held.
  #sentMs = -Infinity;
  #previewed = false;

  constructor(link: Link) {
    this.link = link;
    link.on("state", () => this.#check());
    link.on("released", ({ why }) => {
      const wasHeld = this.held.peek();
      this.release(true);
      if (wasHeld) this.onEnded({ released: why });
    });
    effect(() => {
      if (!link.connected.value && untracked(() => this.held.value)) {
        this.release();
        this.onEnded({ lost: true });
      }
    });
    // When the speed limit changes, here or at the robot, a held deflection means another speed.
    const limits = [computed(() => this.scale.value.speed), computed(() => this.scale.value.turn)];
    effect(() => {
      for (const limit of limits) void limit.value;
      untracked(() => this.#add());
      untracked(() => this.#preview());
    });
    // Some systems report no key-up while this key is down.
    const release = ({ key }: KeyboardEvent) => key === "Meta" && this.release();
    addEventListener("keydown", release, { capture: true });
    addEventListener("blur", () => this.release());
    addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => this.release());
  }

  /** Add a control; returns a function that removes it. */
  add(source: Source): () => void {
    this.#sources.push(source);
    return () => {
      source.cancel();
      this.#sources = this.#sources.filter((other) => other !== source);
      this.changed();
    };
  }

  /** Take over what the controls ask for now. */
  changed(): void {
    // A path is held too, but cannot be followed while another hand drives.
    const yields = ({ alone, follow }: Source) => alone || follow !== undefined;
    const byHand = this.#sources.some((source) => source.held && !yields(source));
    if (byHand) for (const source of this.#sources) if (yields(source)) source.cancel();
    this.#add();
    const drives = this.held.peek() && !this.looksOnly.peek();
    this.#preview();
    if (drives && this.#timer === 0) this.#start();
    else if (!drives && this.#timer !== 0) this.#finish();
    else if (drives) this.#send();
  }

  /** Centre all controls; each acts again only after it was released. */
  release(byServer = false): void {
    for (const source of this.#sources) source.cancel();
    const drove = this.#timer !== 0;
    this.changed();
    if (byServer && !drove) this.link.send({ t: "release" });
  }

  /** Turn the axes of the controls; a held deflection would mean another direction. */
  setFrame(frame: "base_link" | "odom"): void {
    this.release();
    this.frame.value = frame;
  }

  /** Deflection that the robot makes of the command, along the axes of the controls. */
  readonly allowed = computed<Deflection | null>(() => {
    void this.link.beat.value; // A state grows old by itself.
    const state = this.link.state.value;
    if (!state?.commanded || whyNotDrive(this.link) !== null) return null;
    const own = deflectionOf(this.link.robot.value, state.commanded as Twist);
    return this.frame.value === "odom" ? rotated(own, state.pose?.[2] ?? 0) : own;
  });

  /** Add up what the held controls ask for. */
  #add(): void {
    batch(() => {
      const held = this.#sources.filter((source) => source.held);
      const driving = held.filter((source) => !source.looksOnly);
      const acting = driving.length > 0 ? driving : held; // What only looks moves no robot.
      this.looksOnly.value = held.length > 0 && driving.length === 0;
      this.alone.value = acting.some(({ alone }) => alone);
      this.asked.value = acting.length > 0 ? this.#sum(acting) : CENTRED;
      this.held.value = acting.length > 0;
    });
  }

  #sum(acting: readonly Source[]): Deflection {
    const { speed, turn } = this.scale.peek();
    let [x, y, rate] = [0, 0, 0];
    for (const source of acting) {
      const share = source.share ? limited(source.share) : CENTRED;
      x += speed * share.x + (source.speed?.x ?? 0);
      y += speed * share.y + (source.speed?.y ?? 0);
      rate += turn * share.turn + (source.speed?.turn ?? 0);
    }
    const level = this.level.peek() || 1;
    const [most, mostTurn] = [speed / level, turn / level];
    const within = limited({
      x: most > 0 ? x / most : 0,
      y: most > 0 ? y / most : 0,
      turn: mostTurn > 0 ? rate / mostTurn : 0,
    });
    const aside = this.link.robot.peek()?.sideways === false ? 0 : within.y;
    return { x: most * within.x, y: most * aside, turn: mostTurn * within.turn };
  }

  #start(): void {
    const refusal = untracked(() => whyNotDrive(this.link));
    if (refusal !== null) {
      for (const source of this.#sources) source.cancel();
      this.changed();
      this.onEnded({ refusal, atStart: true });
      return;
    }
    this.#timer = setInterval(() => this.#send(), PERIOD_MS);
    this.#send();
  }

  #finish(): void {
    clearInterval(this.#timer);
    this.#timer = 0;
    this.link.send({ t: "release" });
  }

  #send(): void {
    const refusal = untracked(() => whyNotDrive(this.link));
    if (refusal !== null) {
      this.release();
      this.onEnded({ refusal, atStart: false });
      return;
    }
    const now = performance.now();
    if (now - this.#sentMs < MIN_SEND_INTERVAL_MS) return;
    this.#sentMs = now;
    const status_seq = this.link.state.peek()?.status_seq ?? 0;
    const follow = this.#sources.find(({ held, follow }) => held && follow)?.follow;
    if (follow) {
      this.link.send({ ...follow, status_seq });
      return;
    }
    const [vx, vy, omega] = twistOf(this.link.robot.peek(), this.asked.peek());
    this.link.send({ t: "drive", vx, vy, omega, frame: this.frame.peek(), status_seq });
  }

  /** Show in the scene what is only looked at. */
  #preview(): void {
    const shows = this.held.peek() && this.looksOnly.peek();
    if (!shows && !this.#previewed) return;
    this.#previewed = shows;
    const heading = this.frame.peek() === "odom" ? (this.link.state.peek()?.pose?.[2] ?? 0) : 0;
    const own = rotated(this.asked.peek(), -heading); // A preview is along the robot's axes.
    const twist = shows ? twistOf(this.link.robot.peek(), own) : null;
    this.link.send({ t: "preview", twist: twist as [number, number, number] | null });
  }

  /** End a motion that the robot, or the age of its states, no longer permits. */
  #check(): void {
    if (this.#timer === 0) return;
    const refusal = untracked(() => whyNotDrive(this.link));
    if (refusal === null) return;
    const latched = untracked(() => isLatched(this.link));
    this.release();
    // A latched stop is explained beside STOP.
    if (!latched) this.onEnded({ refusal, atStart: false });
  }
}

/** Whether a state shows that the robot moves or is about to stop. */
export function isMoving({ status }: RobotState): boolean {
  return status.mode === "driving" || status.mode === "stopping";
}

/** Whether a refusal is still in force, so that its notice is true. */
export function stillRefused(link: Link, refusal: Refusal): boolean {
  if (freshness(link).kind === "starting") return false;
  const now = whyNotDrive(link);
  return now !== null && codeOf(now) === codeOf(refusal);
}
