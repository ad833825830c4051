// The one command of the page: what all controls ask for together, sent while something is held.

import { computed, effect, signal, untracked } from "@preact/signals";
import type { FollowPlan, Reason } from "../generated/wire";
import type { Link } from "../store/link";
import { isLatched, type Refusal, whyNotDrive } from "../store/permission";
import { CENTRED, type Deflection, deflectionOf, isOnFloor, limited } from "./axes";
import { rotated, scaled, total, type Twist, twistOf } from "./axes";

/** A control that moves the robot: stick, slider, keys, gamepad. It acts only while held. */
export interface Source {
  readonly held: boolean;
  /** Fractions of the speed limit that the operator has chosen. */
  readonly share?: Deflection;
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
  /** Fraction of that limit while the operator drives by a late picture; 0 stops. */
  readonly caution = signal(1);
  readonly frame = signal<"base_link" | "odom">("base_link");
  onEnded: (ended: Ended) => void = () => {};

  /** Controls that act now: those that drive, or else those that only look. */
  readonly #acting = signal<readonly Source[]>([]);
  readonly held = computed(() => this.#acting.value.length > 0);
  readonly looksOnly = computed(() => this.#acting.value.some(({ looksOnly }) => looksOnly));
  /** Whether a control drives on with no hand on it. */
  readonly alone = computed(() => this.#acting.value.some(({ alone }) => alone));
  /** Speed limits of the robot, m/s and rad/s (rad/s twice for a sphere). */
  readonly #most = computed(() => {
    const limits = this.link.state.value?.status.limits;
    const unit_m = this.link.robot.value?.twist_scale_m ?? 1;
    return { speed: (limits?.speed_mps ?? 0) / unit_m, turn: limits?.turn_rate_rad_per_s ?? 0 };
  });
  /** Speed of a full deflection. */
  readonly scale = computed(() => {
    const { speed, turn } = this.#most.value;
    return { speed: this.level.value * speed, turn: this.level.value * turn };
  });
  /** Deflection that all controls ask for, m/s and rad/s along the axes of the controls. */
  readonly asked = computed<Deflection>(() => {
    if (this.#acting.value.length === 0) return CENTRED;
    const { speed, turn } = this.#most.value;
    const level = this.level.value * this.caution.value;
    const shares = this.#acting.value.map(({ share }) => limited(share ?? CENTRED));
    const asked = limited(scaled(total(shares), level, level));
    const isStraight = this.link.robot.value?.sideways === false;
    return scaled(isStraight ? { ...asked, y: 0 } : asked, speed, turn);
  });
  /** Deflection that the robot makes of the command, along the axes of the controls. */
  readonly allowed = computed<Deflection | null>(() => {
    const state = this.link.state.value;
    if (!state?.commanded || whyNotDrive(this.link) !== null) return null;
    const own = deflectionOf(this.link.robot.value, state.commanded);
    return this.frame.value === "odom" ? rotated(own, state.pose?.[2] ?? 0) : own;
  });

  #sources: Source[] = [];
  #timer: ReturnType<typeof setInterval> | 0 = 0; // Zero while nothing is held.
  #sentMs = -Infinity;

  constructor(
    readonly link: Link,
    private readonly refusal: () => Refusal | null = () => whyNotDrive(link),
  ) {
    link.on("state", () => {
      if (this.#timer !== 0) this.#may(false);
    });
    link.on("released", ({ why }) => {
      const [wasHeld, drove] = [this.held.peek(), this.#timer !== 0];
      this.release();
      if (!drove) link.send({ t: "release" }); // The dashboard waits for it.
      if (wasHeld) this.onEnded({ released: why });
    });
    link.on("robot", (robot) => {
      if (!isOnFloor(robot)) this.setFrame("base_link"); // A sphere has no floor.
    });
    effect(() => {
      if (!link.connected.value) untracked(() => this.#onLost());
    });
    const preview = computed(() => JSON.stringify(this.looksOnly.value ? this.#preview() : null));
    let first = true;
    effect(() => {
      const twist = JSON.parse(preview.value) as [number, number, number] | null;
      if (!first) link.send({ t: "preview", twist });
      first = false;
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

  changed(): void {
    // A path is held too, but cannot be followed while another hand drives.
    const yields = ({ alone, follow }: Source) => alone || follow !== undefined;
    if (this.#sources.some((source) => source.held && !yields(source)))
      for (const source of this.#sources) if (yields(source)) source.cancel();
    const held = this.#sources.filter((source) => source.held);
    const driving = held.filter(({ looksOnly }) => !looksOnly);
    this.#acting.value = driving.length > 0 ? driving : held; // Previews move no robot.
    if (driving.length > 0) this.#drive();
    else if (this.#timer !== 0) {
      clearInterval(this.#timer);
      this.#timer = 0;
      this.link.send({ t: "release" });
    }
  }

  /** Centre all controls; each acts again only after it was released. */
  release(): void {
    for (const source of this.#sources) source.cancel();
    this.changed();
  }

  /** Set the axes of the controls; a held deflection would mean another direction. */
  setFrame(frame: "base_link" | "odom"): void {
    this.release();
    this.frame.value = frame;
  }

  #onLost(): void {
    if (!this.held.peek()) return;
    this.release();
    this.onEnded({ lost: true });
  }

  #drive(): void {
    if (this.#timer === 0) {
      if (!this.#may(true)) return;
      this.#timer = setInterval(() => this.#send(), PERIOD_MS);
    }
    this.#send();
  }

  /** Return whether the robot, and the age of its states, permit to drive; else end the motion. */
  #may(atStart: boolean): boolean {
    const refusal = untracked(this.refusal);
    if (refusal === null) return true;
    const latched = untracked(() => isLatched(this.link));
    this.release();
    // The deck explains a latched stop.
    if (atStart || !latched) this.onEnded({ refusal, atStart });
    return false;
  }

  #send(): void {
    const now = performance.now();
    if (!this.#may(false) || now - this.#sentMs < MIN_SEND_INTERVAL_MS) return;
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

  /** Twist that is looked at, along the robot's axes. */
  #preview(): Twist {
    const isOdom = this.frame.value === "odom";
    const heading = isOdom ? (this.link.state.peek()?.pose?.[2] ?? 0) : 0;
    return twistOf(this.link.robot.peek(), rotated(this.asked.value, -heading));
  }
}
