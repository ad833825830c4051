// A module or wheel from above: the robot's front is up, its left is left.

import { onScreen } from "../drive/axes";

/** Point on a dial: right and down of its centre. */
export interface Point {
  right: number;
  down: number;
}

/** Tilt in degrees, and the direction towards which the axle tilts, from ahead to the left. */
export interface Lean {
  tilt: number;
  direction: number | null;
}

const REACH = 36; // Radius of the ring.
const RANGES = [5, 10, 20, 30];
const HYSTERESIS = 0.9; // So that tilts near a range do not switch it back and forth.
const HEAD = 9;
const LEAST = 0.01; // Smaller shares of the ring are drawn as nothing.

/** Range of all rings in degrees: the smallest that shows the largest tilt. */
export function ringRange(tilts: readonly number[], before: number): number {
  const most = Math.max(0, ...tilts);
  const fits = (tilt: number) => RANGES.find((range) => tilt <= range) ?? 10 * Math.ceil(tilt / 10);
  return Math.max(fits(most), Math.min(before, fits(most / HYSTERESIS)));
}

/** Point of the end of an axle on a ring of `range` degrees. */
export function endOfAxle({ tilt, direction }: Lean, range: number): Point {
  const angle = ((direction ?? 0) * Math.PI) / 180;
  const length = direction === null ? 0 : REACH * Math.min(1, tilt / range);
  return onScreen({ x: length * Math.cos(angle), y: length * Math.sin(angle) });
}

/** Point of the tip of a velocity, ahead and left, on a ring of radius `most`. */
export function tipOf([x, y]: readonly [number, number], most: number): Point {
  const scale = most > 0 ? REACH / Math.max(most, Math.hypot(x, y)) : 0;
  return onScreen({ x: scale * x, y: scale * y });
}

interface DialProps {
  /** Measured, with a line from the centre if it is an axle. */
  dot: Point | null;
  isAxle: boolean;
  /** Set-point, or what is looked at. */
  ring: Point | null;
  arrow: Point | null;
  looks: boolean;
  label: string;
}

export function Dial({ dot, isAxle, ring, arrow, looks, label }: DialProps) {
  const at = ({ right, down }: Point) => `${right.toFixed(1)} ${down.toFixed(1)}`;
  const centre = ({ right, down }: Point) => ({ cx: right.toFixed(1), cy: down.toFixed(1) });
  return (
    <svg
      class={looks ? "dial looks" : "dial"}
      viewBox="-42 -42 84 84"
      role="img"
      aria-label={label}
    >
      <circle class="d-ring" r={REACH} />
      <circle class="d-half" r={REACH / 2} />
      <path class="d-cross" d={`M-${REACH} 0H${REACH}M0-${REACH}V${REACH}`} />
      <path class="d-front" d={`M-3.5-${REACH}L0-41L3.5-${REACH}z`} />
      {isAxle && dot && <path class="d-axle" d={`M0 0L${at(dot)}`} />}
      {looks && isAxle && ring && <path class="d-plan" d={`M0 0L${at(ring)}`} />}
      {ring && <circle class="d-set" r="6.5" {...centre(ring)} />}
      {dot && <circle class="d-dot" r="3.6" {...centre(dot)} />}
      {arrow && <Arrow {...arrow} />}
    </svg>
  );
}

function Arrow({ right, down }: Point) {
  const length = Math.hypot(right, down);
  if (length < LEAST * REACH) return null;
  const [r, d] = [right / length, down / length];
  const head = Math.min(HEAD, 0.7 * length);
  const [backRight, backDown] = [right - head * r, down - head * d];
  const corner = (side: number) =>
    `${(backRight - (side * d * head) / 2).toFixed(1)} ${(backDown + (side * r * head) / 2).toFixed(1)}`;
  return (
    <g class="d-push">
      <path d={`M0 0L${backRight.toFixed(1)} ${backDown.toFixed(1)}`} />
      <path
        class="head"
        d={`M${right.toFixed(1)} ${down.toFixed(1)}L${corner(1)}L${corner(-1)}z`}
      />
    </g>
  );
}
