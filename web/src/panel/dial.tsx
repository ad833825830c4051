// A module or wheel from above: the robot's front is up, its left is left.

import type { ComponentChildren } from "preact";
import { onScreen } from "../drive/axes";
import type { GimbalPose } from "../generated/wire";
import { degrees } from "../text/text";

/** Point on a dial: right and down of its centre. */
type Point = ReturnType<typeof onScreen>;

export const REACH = 36; // Radius of the ring.
const RANGES = [5, 10, 20, 30];
const HYSTERESIS = 0.9; // So that tilts near a range do not switch it back and forth.
const HEAD = 9;
const LEAST = 0.4; // Shorter arrows are not drawn.

/** Range of all rings in degrees: the smallest that shows the largest tilt. */
export function ringRange(tilts: readonly number[], before: number): number {
  const most = Math.max(0, ...tilts);
  const fits = (tilt: number) => RANGES.find((range) => tilt <= range) ?? 10 * Math.ceil(tilt / 10);
  return Math.max(fits(most), Math.min(before, fits(most / HYSTERESIS)));
}

/** End of an axle on a ring of `range` degrees; its direction counts from ahead to the left. */
export function endOfAxle(
  { tilt = 0, direction = null }: Partial<Pick<GimbalPose, "tilt" | "direction">>,
  range: number,
): Point {
  const angle = ((direction ?? 0) * Math.PI) / 180;
  const length = direction === null ? 0 : REACH * Math.min(1, tilt / range);
  return onScreen({ x: length * Math.cos(angle), y: length * Math.sin(angle) });
}

/** Tip of a velocity, ahead and left, on a ring of radius `most`. */
export function tipOf([x, y]: readonly [number, number], most: number): Point {
  const scale = most > 0 ? REACH / Math.max(most, Math.hypot(x, y)) : 0;
  return onScreen({ x: scale * x, y: scale * y });
}

export function Ring({ label, children }: { label: string; children: ComponentChildren }) {
  return (
    <svg class="dial" viewBox="-42 -42 84 84" role="img" aria-label={label}>
      <circle class="d-ring" r={REACH} />
      <circle class="d-cross" r={REACH / 2} />
      <path class="d-cross" d={`M-${REACH} 0H${REACH}M0-${REACH}V${REACH}`} />
      <path class="d-front" d={`M-3.5-${REACH}L0-41L3.5-${REACH}z`} />
      {children}
    </svg>
  );
}

interface DialProps {
  label: string;
  /** Measured axle or push. */
  dot: Point | undefined;
  /** Axle of the set-point, or of the preview. */
  goal?: Point | undefined;
  push: Point | undefined;
}

export function Dial({ label, dot, goal, push }: DialProps) {
  return (
    <Ring label={label}>
      {dot && <line class="d-axle" x2={dot.right} y2={dot.down} />}
      {goal && <line class="d-plan" x2={goal.right} y2={goal.down} />}
      {goal && <circle class="d-set" r="6.5" cx={goal.right} cy={goal.down} />}
      {dot && <circle class="d-dot" r="2.4" cx={dot.right} cy={dot.down} />}
      {push && <Arrow {...push} />}
    </Ring>
  );
}

function Arrow({ right, down }: Point) {
  const length = Math.hypot(right, down);
  if (length < LEAST) return null;
  const head = Math.min(HEAD, 0.7 * length);
  return (
    <g class="d-push" transform={`rotate(${degrees(Math.atan2(right, -down))})`}>
      <path d={`M0 0V${head - length}`} />
      <path class="head" d={`M0-${length}l${head / 2} ${head}h-${head}z`} />
    </g>
  );
}
