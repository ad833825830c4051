// Motion of a sphere that brings a point to its top: after a click on the sphere, or by name. Any
// other control, or release, ends it.

import type { SphereClick } from "../generated/wire";
import type { Link } from "../store/link";
import { type Deflection, deflectionOf, scaled } from "./axes";
import type { Drive, Source } from "./drive";

type Vector = readonly [number, number, number];
type Quaternion = readonly [number, number, number, number];

const CLICK_MS = 3000; // Allows for the delay of the server's message.
const TIMEOUT_MS = 30_000;
const NEAR_RAD = 0.01;
const APPROACH_PER_S = 2;

export class SphereTurn implements Source {
  readonly alone = true;
  #goal: { at: Vector; untilMs: number } | null = null;
  #clickedMs = -Infinity;

  constructor(
    private readonly link: Link,
    private readonly drive: Drive,
  ) {
    drive.add(this);
    link.on("sphere_click", (click) => this.#take(click));
    link.on("robot", () => this.cancel());
    link.on("state", () => this.#check());
  }

  get held(): boolean {
    return this.#goal !== null;
  }

  /** Shortest rotation that brings the point up, slower when it is near. */
  get share(): Deflection {
    const [x, y] = this.#rotation() ?? [0, 0];
    const most = Math.max(1e-6, this.drive.scale.peek().speed);
    return scaled(deflectionOf(this.link.robot.peek(), [x, y, 0]), APPROACH_PER_S / most);
  }

  /** Bring a point up, given as a unit vector along the axes painted on the sphere. */
  bring(at: Vector): void {
    this.#goal = { at, untilMs: performance.now() + TIMEOUT_MS };
    this.drive.changed();
  }

  cancel(): void {
    this.#goal = null;
  }

  /** Note that this page has clicked on the scene; clicks of other pages move nothing. */
  clicked(): void {
    this.#clickedMs = performance.now();
  }

  #take({ robot, at }: SphereClick): void {
    const isOwn = performance.now() - this.#clickedMs < CLICK_MS;
    this.#clickedMs = -Infinity; // One motion per click.
    if (isOwn && robot === this.link.robot.peek()?.id) this.bring(at);
  }

  #check(): void {
    if (this.#goal === null) return;
    const way = this.#rotation();
    const isLate = performance.now() > this.#goal.untilMs;
    if (way === null || Math.hypot(...way) < NEAR_RAD || isLate) this.cancel();
    this.drive.changed();
  }

  /** Remaining rotation about the horizontal axes, by the angle of the point from the top. */
  #rotation(): [number, number] | null {
    const sphere = this.link.state.peek()?.sphere;
    if (!sphere || this.#goal === null) return null;
    const [x, y, z] = turned(sphere.wxyz, this.#goal.at);
    const level = Math.hypot(x, y);
    if (level < 1e-6) return [0, z > 0 ? 0 : Math.PI];
    const angle = Math.atan2(level, z);
    return [(angle * y) / level, (-angle * x) / level];
  }
}

/** Rotate a vector by a unit quaternion w, x, y, z. */
export function turned([w, x, y, z]: Quaternion, [a, b, c]: Vector): Vector {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}
