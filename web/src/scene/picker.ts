// Choice of a goal or a line with the pointer, on the scene or the map: a click is a goal, a drag
// sets the heading there, and a drawn line is followed. The goal keeps a handle for its heading.

import { signal, untracked } from "@preact/signals";
import { isOver, type Path, type Wish } from "../drive/path";
import type { Pixel } from "./map_view";

/** Where pixels have places: the picture, in fractions, or the floor, in metres. */
export interface Surface {
  on: Wish["on"];
  toPlace(pixel: Pixel): [number, number];
  toPixel(place: Pixel): Pixel;
}

export interface Goal {
  at: Pixel;
  handle: Pixel;
  /** Whether a heading was chosen; otherwise the robot keeps its own. */
  turns: boolean;
}

export const MIN_STEP_PX = 5;
const HANDLE_PX = 44; // From the goal to its handle, if no heading was drawn.
const GRAB_PX = 22;
const MAX_POINTS = 200; // A message allows slightly more.

export class Picker {
  /** Pixels of the click, drag or line under way. */
  readonly stroke = signal<readonly Pixel[]>([]);
  readonly #path: Path;
  readonly #surface: Surface;

  constructor(path: Path, surface: Surface) {
    this.#path = path;
    this.#surface = surface;
  }

  /** The goal in pixels, until its path has ended; reads signals. */
  goal(): Goal | null {
    const { wish, route } = this.#path;
    const drawn = this.stroke.value;
    if (drawn.length > 0) return this.#draws ? null : goalOf(drawn[0]!, drawn[1]);
    if (wish.value?.kind !== "to" || wish.value.on !== this.#surface.on) return null;
    if (route.value !== null && isOver(route.value)) return null;
    const [at, facing] = wish.value.points.map((place) => this.#surface.toPixel(place));
    const heading = wish.value.heading ?? null;
    if (at === undefined) return null;
    if (facing !== undefined || heading === null) return goalOf(at, facing);
    const [right, down] = [-Math.sin(heading), -Math.cos(heading)]; // On the map, x is up.
    return goalOf(at, [at[0] + HANDLE_PX * right, at[1] + HANDLE_PX * down]);
  }

  /** The drawn line, until its path is planned and shown instead; reads signals. */
  line(): readonly Pixel[] {
    const { wish, route } = this.#path;
    if (this.stroke.value.length > 0) return this.#draws ? this.stroke.value : [];
    const isPlanned = route.value !== null && route.value.phase !== "planning";
    if (wish.value?.kind !== "draw" || wish.value.on !== this.#surface.on || isPlanned) return [];
    return wish.value.points.map((place) => this.#surface.toPixel(place));
  }

  /** A pointer is pressed: at the handle it turns the goal, elsewhere it begins another. */
  begin(pixel: Pixel): void {
    const goal = this.#draws ? null : untracked(() => this.goal());
    const turns = goal !== null && distance(goal.handle, pixel) <= GRAB_PX;
    if (!this.#path.held) this.stroke.value = turns ? [goal.at, pixel] : [pixel];
  }

  move(pixel: Pixel): void {
    const stroke = this.stroke.peek();
    const last = stroke.at(-1);
    if (last === undefined) return;
    if (distance(pixel, last) < MIN_STEP_PX) return;
    this.stroke.value = this.#draws ? [...stroke, pixel] : [stroke[0]!, pixel];
  }

  /** The pointer is released: plan. */
  finish(): void {
    const points = thinned(this.stroke.peek()).map((pixel) => this.#surface.toPlace(pixel));
    this.stroke.value = [];
    if (points.length === 0 || this.#path.held) return;
    const kind = this.#draws ? "draw" : "to";
    this.#path.plan({ kind, on: this.#surface.on, points });
  }

  cancel(): void {
    this.stroke.value = [];
  }

  get #draws(): boolean {
    return this.#path.mode.peek() === "draw";
  }
}

function goalOf(at: Pixel, facing: Pixel | undefined): Goal {
  return { at, handle: facing ?? [at[0], at[1] - HANDLE_PX], turns: facing !== undefined };
}

function distance(a: Pixel, b: Pixel): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

/** Drop every second point until few enough remain; keep the ends. */
export function thinned(points: readonly Pixel[]): readonly Pixel[] {
  let few = points;
  while (few.length > MAX_POINTS)
    few = few.filter((_, i, all) => i % 2 === 0 || i === all.length - 1);
  return few;
}
