// Choice of a goal or a line with the pointer, on the scene or the map: a click is a goal, a drag
// sets the heading there, and a drawn line is followed. The goal keeps a handle for its heading.

import { signal, untracked } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { HeldPointer } from "../drive/held";
import { isOver, type Path, type Wish } from "../drive/path";
import { useSession } from "../session";

/** Pixels to the right and down. */
export type Pixel = readonly [number, number];
export type Point = readonly [number, number];

/** Where pixels have places: the picture, in fractions, or the floor, in metres. */
export interface Surface {
  on: Wish["on"];
  toPlace(pixel: Pixel, size: Pixel): [number, number];
  toPixel(place: Point, size: Pixel): Pixel;
}

interface Goal {
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
  /** Pixels of the current click, drag or line. */
  readonly stroke = signal<readonly Pixel[]>([]);
  readonly size = signal<Pixel>([1, 1]);

  constructor(
    private readonly path: Path,
    readonly surface: Surface,
  ) {}

  /** The goal in pixels, until its path has ended; reads signals. */
  goal(): Goal | null {
    const drawn = this.stroke.value;
    if (drawn.length > 0) return this.#draws ? null : goalOf(drawn[0]!, drawn[1]);
    const { route } = this.path;
    if (route.value !== null && isOver(route.value)) return null;
    const [at, facing] = this.#wished("to");
    const heading = this.path.wish.value?.heading ?? null;
    if (at === undefined) return null;
    if (facing !== undefined || heading === null) return goalOf(at, facing);
    const [right, down] = [-Math.sin(heading), -Math.cos(heading)]; // On the map, x is up.
    return goalOf(at, [at[0] + HANDLE_PX * right, at[1] + HANDLE_PX * down]);
  }

  /** The drawn line, until its path is planned and shown instead; reads signals. */
  line(): readonly Pixel[] {
    if (this.stroke.value.length > 0) return this.#draws ? this.stroke.value : [];
    const isPlanned = (this.path.route.value?.phase ?? "planning") !== "planning";
    return isPlanned ? [] : this.#wished("draw");
  }

  /** A pointer is pressed: at the handle it turns the goal, elsewhere it begins another. */
  begin(pixel: Pixel): void {
    const goal = this.#draws ? null : untracked(() => this.goal());
    const turns = goal !== null && distance(goal.handle, pixel) <= GRAB_PX;
    if (!this.path.held) this.stroke.value = turns ? [goal.at, pixel] : [pixel];
  }

  move(pixel: Pixel): void {
    const stroke = this.stroke.peek();
    const last = stroke.at(-1);
    if (last === undefined || distance(pixel, last) < MIN_STEP_PX) return;
    this.stroke.value = this.#draws ? [...stroke, pixel] : [stroke[0]!, pixel];
  }

  /** The pointer is released: plan. */
  finish(): void {
    const { on, toPlace } = this.surface;
    const points = thinned(this.stroke.peek()).map((pixel) => toPlace(pixel, this.size.peek()));
    this.cancel();
    if (points.length === 0 || this.path.held) return;
    const wish: Wish = { kind: this.#draws ? "draw" : "to", on, points };
    this.path.plan(wish);
    // In that mode the goal can be turned by its handle.
    const isPlanned = this.path.wish.peek() === wish;
    if (isPlanned && this.path.mode.peek() === "stick") this.path.choose("to");
  }

  cancel(): void {
    this.stroke.value = [];
  }

  get #draws(): boolean {
    return this.path.mode.peek() === "draw";
  }

  /** Pixels of the last request. */
  #wished(kind: Wish["kind"]): Pixel[] {
    const { on, toPixel } = this.surface;
    const wish = this.path.wish.value;
    if (wish?.kind !== kind || wish.on !== on) return [];
    return wish.points.map((place) => toPixel(place, this.size.value));
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

/** Layer over a surface that handles the pointer and shows the choice. */
export function PickLayer({ picker }: { picker: Picker }) {
  const layer = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const node = layer.current!;
    const placeOf = ({ clientX, clientY }: PointerEvent): Pixel => {
      const { left, top } = node.getBoundingClientRect();
      return [clientX - left, clientY - top];
    };
    const ending = new AbortController();
    const held = {
      came: (event: PointerEvent) => picker.begin(placeOf(event)),
      moved: (event: PointerEvent) => picker.move(placeOf(event)),
      gone: ({ type }: PointerEvent) => (type === "pointerup" ? picker.finish() : picker.cancel()),
    };
    new HeldPointer(node, held, ending.signal);
    const resized = new ResizeObserver(() => {
      picker.size.value = [node.clientWidth || 1, node.clientHeight || 1];
    });
    resized.observe(node);
    return () => {
      ending.abort();
      resized.disconnect();
    };
  }, [picker]);
  const goal = picker.goal();
  return (
    <div ref={layer} class={`picks on-${picker.surface.on}`} aria-hidden="true">
      <svg>
        <polyline class="pick-line" points={picker.line().join(" ")} />
        {goal && (
          <g class={goal.turns ? "pick-goal turns" : "pick-goal"}>
            <path d={`M${goal.at}L${goal.handle}`} />
            <circle cx={goal.at[0]} cy={goal.at[1]} r={7} />
            <circle class="handle" cx={goal.handle[0]} cy={goal.handle[1]} r={7} />
          </g>
        )}
      </svg>
    </div>
  );
}

/** The frame of the picture has another origin, so no pointer of it reaches the page. */
const PICTURE: Surface = {
  on: "picture",
  toPlace: ([right, down], [width, height]) => [fraction(right / width), fraction(down / height)],
  toPixel: ([x, y], [width, height]) => [x * width, y * height],
};

function fraction(share: number): number {
  return Number(Math.max(0, Math.min(1, share)).toFixed(5));
}

/** While the robot follows a path, the picture takes the pointer, and the camera can be moved. */
export function PicturePicker() {
  const { path, view } = useSession();
  const picker = useMemo(() => new Picker(path, PICTURE), [path]);
  // Another camera or size gives the pixels other places.
  const forget = () => {
    if (path.wish.peek()?.on === "picture") path.wish.value = null;
  };
  useEffect(() => forget, [view.settings.value, picker.size.value]);
  return path.mode.value === "stick" || path.going.value ? null : <PickLayer picker={picker} />;
}
