// Part of the floor that the map shows, and the trails on it. World x is up and y is left, as on the
// stick with the axes of the floor.

import type { MapRobot } from "../generated/wire";

export type Point = readonly [number, number];
/** Pixels to the right and down. */
export type Pixel = readonly [number, number];

const [LEAST_SPAN_M, MOST_SPAN_M] = [0.5, 64]; // Along the smaller side.
const INITIAL_SPAN_M = 4;
const CALM = 0.25; // Maximum offset of the robot from the centre, relative to the smaller side.
const BAR_SHARE = 0.4; // Maximum length of the scale bar, relative to the width.
const LEAST_GRID_PX = 8;

export class MapView {
  spanM = INITIAL_SPAN_M;
  size = { width: 1, height: 1 };
  #middle: Point = [0, 0];

  /** Pixels per metre. */
  get scale(): number {
    return Math.min(this.size.width, this.size.height) / this.spanM;
  }

  setSpan(spanM: number): void {
    if (Number.isFinite(spanM)) this.spanM = clamped(spanM, LEAST_SPAN_M, MOST_SPAN_M);
  }

  /** Enlarge what is shown by a factor; the place at `at` keeps its pixel. */
  zoom(factor: number, at: Pixel = [this.size.width / 2, this.size.height / 2]): void {
    const [x, y] = this.#unrounded(at);
    this.setSpan(this.spanM / factor);
    const [nowX, nowY] = this.#unrounded(at);
    this.#middle = [this.#middle[0] + x - nowX, this.#middle[1] + y - nowY];
  }

  /** Move the picture by pixels. */
  pan([right, down]: Pixel): void {
    this.#middle = [this.#middle[0] + down / this.scale, this.#middle[1] + right / this.scale];
  }

  /** Pan as little as needed to keep a place near the centre. */
  follow(place: Point): void {
    const most = CALM * this.spanM;
    const nearer = (at: number, to: number) => clamped(at, to - most, to + most);
    this.#middle = [nearer(this.#middle[0], place[0]), nearer(this.#middle[1], place[1])];
  }

  toPixels([x, y]: Point): Pixel {
    const { width, height } = this.size;
    return [
      width / 2 - (y - this.#middle[1]) * this.scale,
      height / 2 - (x - this.#middle[0]) * this.scale,
    ];
  }

  /** Floor point of a pixel, rounded to 1 mm. */
  toFloor(pixel: Pixel): [number, number] {
    const [x, y] = this.#unrounded(pixel);
    return [Math.round(1000 * x) / 1000, Math.round(1000 * y) / 1000];
  }

  #unrounded([right, down]: Pixel): Point {
    const { width, height } = this.size;
    return [
      this.#middle[0] + (height / 2 - down) / this.scale,
      this.#middle[1] + (width / 2 - right) / this.scale,
    ];
  }

  /** Length of the scale bar in metres: 1, 2 or 5 times a power of ten. */
  barM(): number {
    const most = (BAR_SHARE * this.size.width) / this.scale;
    const power = 10 ** Math.floor(Math.log10(most));
    return ([5, 2, 1].find((each) => each * power <= most) ?? 1) * power;
  }

  /** Spacing of the grid: 1 m, or 10 m if the lines would be too close. */
  gridM(): number {
    return this.scale >= LEAST_GRID_PX ? 1 : 10;
  }
}

function clamped(value: number, low: number, high: number): number {
  return Math.max(low, Math.min(high, value));
}

export interface Labelled {
  at: Pixel;
  radius: number;
  width: number;
}

interface Box {
  left: number;
  right: number;
  top: number;
  bottom: number;
}

const LABEL_GAP_PX = 14; // Room for the tip of a robot.
const LABEL_PX = 16; // Line height including gap.

/**
 * Return label positions (centre of the baseline, in pixels): below, above, right or left of the
 * robots, never on another label, and not on a circle if there is room. A label is not cut off at
 * the edges `low` and `high` while its robot is between them.
 */
export function labelPlaces(
  robots: readonly Labelled[],
  [low, high]: Point = [-Infinity, Infinity],
): Pixel[] {
  const taken: Box[] = [];
  const circles = robots.map(({ at: [x, y], radius }) => around(x, y, radius));
  return robots.map(({ at: [x, y], radius, width }) => {
    const [aside, below] = [radius + LABEL_GAP_PX + width / 2, radius + LABEL_GAP_PX + 10];
    const isIn = low <= x && x <= high;
    const middle = isIn ? Math.max(low + width / 2 + 4, Math.min(x, high - width / 2 - 4)) : x;
    const first: Pixel = [middle, y + below];
    const places: Pixel[] = [
      first,
      [middle, y - radius - LABEL_GAP_PX],
      [x + aside, y + 4],
      [x - aside, y + 4],
      ...robots.map((_, i): Pixel => [middle, y + below + (i + 1) * LABEL_PX]),
    ];
    const boxOf = ([right, down]: Pixel): Box => ({
      left: right - width / 2 - 2,
      right: right + width / 2 + 2,
      top: down - LABEL_PX + 4,
      bottom: down + 4,
    });
    const free = (others: readonly Box[]) =>
      places.find((each) => !others.some((other) => overlap(boxOf(each), other)));
    const place = free([...taken, ...circles]) ?? free(taken) ?? first;
    taken.push(boxOf(place));
    return place;
  });
}

function around(x: number, y: number, radius: number): Box {
  return { left: x - radius, right: x + radius, top: y - radius, bottom: y + radius };
}

function overlap(a: Box, b: Box): boolean {
  return a.right > b.left && a.left < b.right && a.bottom > b.top && a.top < b.bottom;
}

const TRAIL_SPACING_M = 0.05; // As in sessions/map_data.py, like the next two.
const TRAIL_JUMP_M = 0.5;
const TRAIL_POINTS = 800;

/** Trails of the estimates: those from the server, extended with the latest poses. */
export class MapTrails {
  #trails = new Map<string, (Point | null)[]>();

  replace(trails: Record<string, readonly (Point | null)[]>): void {
    this.#trails = new Map(Object.entries(trails).map(([id, trail]) => [id, [...trail]]));
  }

  extend(robots: readonly MapRobot[]): void {
    for (const { id, pose } of robots) {
      const trail = this.#trails.get(id) ?? [];
      this.#trails.set(id, trail);
      const last = trail.at(-1);
      const step = last ? Math.hypot(pose[0] - last[0], pose[1] - last[1]) : Infinity;
      if (step < TRAIL_SPACING_M) continue;
      if (last && step >= TRAIL_JUMP_M) trail.push(null);
      trail.push([pose[0], pose[1]]);
      if (trail.length > TRAIL_POINTS) trail.splice(0, trail.length - TRAIL_POINTS);
    }
  }

  of(id: string): readonly (Point | null)[] {
    return this.#trails.get(id) ?? [];
  }
}
