// Visible part of the floor, and positions on it. World x is up and y is left, as on
// the stick with the axes of the floor.

import { signal } from "@preact/signals";
import { figure } from "../text/text";
import type { Pixel, Point } from "./pick";

const [LEAST_SPAN_M, MOST_SPAN_M] = [0.5, 64];
const CALM = 0.25; // Maximum offset of the robot from the centre, relative to the span.

export class MapView {
  /** Length along the smaller side, in metres. */
  readonly span = signal(4);
  readonly middle = signal<Point>([0, 0]);

  zoom(factor: number): void {
    this.span.value = clamped(this.span.peek() / factor, LEAST_SPAN_M, MOST_SPAN_M);
  }

  /** Pan as little as needed to keep a place near the centre. */
  follow([x, y]: Point): void {
    const [atX, atY] = this.middle.peek();
    const most = CALM * this.span.peek();
    const next = [clamped(atX, x - most, x + most), clamped(atY, y - most, y + most)] as const;
    if (next[0] !== atX || next[1] !== atY) this.middle.value = next;
  }

  /** Metres per pixel of a picture. */
  scale([width, height]: Pixel): number {
    return this.span.value / Math.min(width, height);
  }

  toPixel([x, y]: Point, size: Pixel): Pixel {
    const [middleX, middleY] = this.middle.value;
    const scale = this.scale(size);
    return [size[0] / 2 - (y - middleY) / scale, size[1] / 2 - (x - middleX) / scale];
  }

  /** Floor point of a pixel, rounded to 1 mm. */
  toPlace([right, down]: Pixel, size: Pixel): [number, number] {
    const [middleX, middleY] = this.middle.value;
    const scale = this.scale(size);
    const x = middleX + (size[1] / 2 - down) * scale;
    const y = middleY + (size[0] / 2 - right) * scale;
    return [Math.round(1000 * x) / 1000, Math.round(1000 * y) / 1000];
  }

  /** Spacing of the grid and length of the scale bar: a power of ten, at most half of the span. */
  gridM(): number {
    return 10 ** Math.floor(Math.log10(this.span.value / 2));
  }
}

function clamped(value: number, low: number, high: number): number {
  return Math.max(low, Math.min(high, value));
}

/** Length in metres or centimetres, for the scale bar. */
export function lengthText(metres: number): string {
  return metres < 0.995 ? `${figure(100 * metres)} cm` : `${figure(metres)} m`;
}

const [LETTER_PX, LINE_PX, PADDING_PX] = [8, 16, 6]; // Maximum size of a letter of a name.

interface Label {
  text: string;
  /** Middle of the upper edge. */
  at: Pixel;
}

const halfWidth = ({ text }: Label): number => 0.5 * (LETTER_PX * text.length + PADDING_PX);

/** Return the labels within a picture, moved away from its edges, without those over earlier ones. */
export function fitting<L extends Label>(labels: readonly L[], [width, height]: Pixel): L[] {
  const kept: L[] = [];
  for (const label of labels) {
    const [right, down] = label.at;
    const half = halfWidth(label);
    if (right < 0 || right > width || down < 0 || down > height - LINE_PX) continue;
    const moved = { ...label, at: [clamped(right, half, width - half), down] as const };
    const covers = (other: L) =>
      Math.abs(other.at[0] - moved.at[0]) < half + halfWidth(other) &&
      Math.abs(other.at[1] - down) < LINE_PX;
    if (!kept.some(covers)) kept.push(moved);
  }
  return kept;
}

const TRAIL_SPACING_M = 0.05; // As in sessions/map_data.py, like the next two.
const TRAIL_JUMP_M = 0.5;
const TRAIL_POINTS = 800;

/** Trail of an estimate, with null between discontinuous parts. */
export type Trail = readonly (Point | null)[];

/** Return a trail with the latest place, if that is far enough from the last one. */
export function extended(trail: Trail, [x, y]: Point): Trail {
  const last = trail.at(-1);
  const step = last ? Math.hypot(x - last[0], y - last[1]) : Infinity;
  if (step < TRAIL_SPACING_M) return trail;
  const gap = last && step >= TRAIL_JUMP_M ? [null] : [];
  return [...trail, ...gap, [x, y] as const].slice(-TRAIL_POINTS);
}
