// Axes of the controls: ahead and left on the stick, and turning left; per kind of robot.

import type { RobotInfo } from "../generated/wire";

/** Three components of a twist along the axes that the robot declares. */
export type Twist = readonly [number, number, number];

/** Deflection ahead, to the left, and turning left. */
export interface Deflection {
  readonly x: number;
  readonly y: number;
  readonly turn: number;
}

export const CENTRED: Deflection = { x: 0, y: 0, turn: 0 };

/** Whether a robot drives on the floor; otherwise it is a sphere that turns in place. */
export function isOnFloor(robot: RobotInfo | null): boolean {
  return robot?.space !== "sphere";
}

/** Twist of a deflection. Up rolls the top of a sphere away (about Y), left rolls it left. */
export function twistOf(robot: RobotInfo | null, { x, y, turn }: Deflection): Twist {
  return isOnFloor(robot) ? [x, y, turn] : [-y, x, turn];
}

export function deflectionOf(robot: RobotInfo | null, [a, b, turn]: Twist): Deflection {
  return isOnFloor(robot) ? { x: a, y: b, turn } : { x: b, y: -a, turn };
}

/** Point on the screen of a deflection: right and down. The only such mapping of the page. */
export function onScreen({ x, y }: Pick<Deflection, "x" | "y">): { right: number; down: number } {
  return { right: y === 0 ? 0 : -y, down: x === 0 ? 0 : -x };
}

/** Scale a deflection to at most 1 in the plane and in turning. */
export function limited({ x, y, turn }: Deflection): Deflection {
  const length = Math.max(1, Math.hypot(x, y));
  return { x: x / length, y: y / length, turn: Math.max(-1, Math.min(1, turn)) };
}

export function scaled({ x, y, turn }: Deflection, plane: number, turning = 0): Deflection {
  return { x: plane * x, y: plane * y, turn: turning * turn };
}

/** Add deflections up; components that are not given are zero. */
export function total(parts: readonly Partial<Deflection>[]): Deflection {
  const sum = (axis: keyof Deflection) => parts.reduce((all, part) => all + (part[axis] ?? 0), 0);
  return { x: sum("x"), y: sum("y"), turn: sum("turn") };
}

/** Turn a deflection by `angle` to the left. */
export function rotated({ x, y, turn }: Deflection, angle: number): Deflection {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return { x: c * x - s * y, y: s * x + c * y, turn };
}
