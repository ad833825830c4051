// Map: a small picture of the floor from above. A click on it plans a path, with the same request as
// a click in the scene; nothing moves. Wheel and pinch zoom, a drag moves the picture.

import { effect, signal, untracked } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { isOnFloor } from "../drive/axes";
import { HeldPointer } from "../drive/held";
import type { MapLines } from "../generated/wire";
import { type Session, useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { isFlag, remembered } from "../store/memory";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import { MapDrawing } from "./map_drawing";
import { MapTrails, MapView, type Pixel } from "./map_view";
import { MIN_STEP_PX, Picker } from "./picker";

const DENSEST = 2;
const WHEEL_PER_PX = 0.0015;
const BUTTON_ZOOM = 2;

const isSpan = (stored: unknown): stored is number => typeof stored === "number";

export class FloorMap {
  readonly open = remembered("tsd-map", !matchMedia("(max-width: 899px)").matches, isFlag);
  readonly large = signal(false);
  /** Whether it was moved away from the robot by hand. */
  readonly away = signal(false);
  readonly shown: () => boolean;
  readonly #session: Session;
  readonly #view = new MapView();
  readonly #trails = new MapTrails();
  readonly #span = remembered("tsd-map-span", this.#view.spanM, isSpan);
  readonly #picker: Picker;
  #routes: MapLines["routes"] = {};

  constructor(session: Session) {
    this.#session = session;
    const { link, path } = session;
    this.#view.setSpan(this.#span.peek());
    this.shown = () => this.open.value && link.robot.value !== null && isOnFloor(link.robot.value);
    this.#picker = new Picker(path, {
      on: "floor",
      toPlace: (pixel) => this.#view.toFloor(pixel),
      toPixel: (place) => this.#view.toPixels(place),
    });
    link.on("map_lines", ({ routes, trails }) => {
      this.#routes = routes;
      if (trails !== null) this.#trails.replace(trails);
    });
    link.on("state", ({ map }) => map && this.#trails.extend(map.robots));
    let on = false;
    effect(() => {
      const welcome = link.welcome.value; // After each connection.
      if (welcome && (this.shown() || on)) link.send({ t: "map", on: (on = this.shown()) });
    });
  }

  toggle(): void {
    this.open.value = !this.open.peek();
    this.large.value = false;
  }

  zoom(factor: number, at?: Pixel): void {
    this.#view.zoom(factor, at);
    this.#span.value = this.#view.spanM;
  }

  /** Take pointers of the canvas and draw on it; returns a function that ends it. */
  attach(canvas: HTMLCanvasElement): () => void {
    const pointer = this.#takePointer(canvas);
    const wheel = (event: WheelEvent) => {
      event.preventDefault();
      this.zoom(Math.exp(-WHEEL_PER_PX * event.deltaY), placeOn(canvas, event));
    };
    canvas.addEventListener("wheel", wheel, { passive: false });
    const pinch = this.#takePinch(canvas, pointer);
    const stop = effect(() => void (this.#session.link.beat.value >= 0 && this.#draw(canvas)));
    return () => {
      stop();
      pointer.end();
      pinch.abort();
      canvas.removeEventListener("wheel", wheel);
    };
  }

  /** A click chooses a goal; a drag moves the picture, or turns the goal or draws in those modes. */
  #takePointer(canvas: HTMLCanvasElement): HeldPointer {
    const { path } = this.#session;
    let first: Pixel = [0, 0];
    let last: Pixel | null = null; // While the picture may be moved.
    let moved = false;
    return new HeldPointer(canvas, {
      came: (event) => {
        first = placeOn(canvas, event);
        last = path.mode.peek() === "stick" ? first : null;
        moved = false;
        this.#picker.begin(first);
      },
      moved: (event) => {
        const here = placeOn(canvas, event);
        if (last === null) return this.#picker.move(here);
        moved ||= Math.hypot(here[0] - first[0], here[1] - first[1]) >= MIN_STEP_PX;
        if (!moved) return;
        this.#picker.cancel();
        this.#view.pan([here[0] - last[0], here[1] - last[1]]);
        this.away.value = true;
        last = here;
      },
      gone: ({ type }) => (type === "pointerup" && !moved ? this.#pick() : this.#picker.cancel()),
    });
  }

  #pick(): void {
    const { path } = this.#session;
    const before = path.wish.peek();
    this.#picker.finish();
    // In that mode the goal can be turned by its handle.
    if (path.wish.peek() !== before && path.mode.peek() === "stick") path.choose("to");
  }

  /** Two fingers zoom; the second one ends what the first has begun. */
  #takePinch(canvas: HTMLCanvasElement, pointer: HeldPointer): AbortController {
    const ending = new AbortController();
    const { signal: ended } = ending;
    const fingers = new Map<number, Pixel>();
    const spread = () => {
      const [a = [0, 0], b = a] = [...fingers.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    const down = (event: PointerEvent) => {
      fingers.set(event.pointerId, placeOn(canvas, event));
      if (fingers.size !== 2) return;
      pointer.cancel();
      this.#picker.cancel();
    };
    const move = (event: PointerEvent) => {
      if (!fingers.has(event.pointerId)) return;
      const before = spread();
      fingers.set(event.pointerId, placeOn(canvas, event));
      const [a, b] = [...fingers.values()];
      if (fingers.size !== 2 || before === 0 || !a || !b) return;
      this.zoom(spread() / before, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
    };
    const up = (event: PointerEvent) => void fingers.delete(event.pointerId);
    canvas.addEventListener("pointerdown", down, { signal: ended });
    canvas.addEventListener("pointermove", move, { signal: ended });
    for (const end of ["pointerup", "pointercancel", "pointerleave"] as const)
      canvas.addEventListener(end, up, { signal: ended });
    return ending;
  }

  #draw(canvas: HTMLCanvasElement): void {
    const pen = canvas.getContext("2d");
    const { clientWidth: width, clientHeight: height } = canvas;
    if (pen === null || width === 0) return;
    const { link } = this.#session;
    const density = Math.min(DENSEST, devicePixelRatio);
    const [wide, high] = [Math.round(width * density), Math.round(height * density)];
    if (canvas.width !== wide || canvas.height !== high)
      [canvas.width, canvas.height] = [wide, high];
    this.#view.size = { width, height };
    const map = link.state.peek()?.map;
    const robots = map?.robots ?? [];
    const shown = robots.find(({ id }) => id === link.robot.peek()?.id);
    if (shown && !this.away.value && this.#picker.stroke.value.length === 0)
      this.#view.follow([shown.pose[0], shown.pose[1]]);
    pen.setTransform(density, 0, 0, density, 0, 0);
    new MapDrawing(pen, this.#view, {
      robots,
      shown,
      names: new Map(link.welcome.peek()?.robots.map((robot) => [robot.id, robot])),
      isStale: untracked(() => !isCurrent(freshness(link))),
      envelope: map?.envelope ?? null,
      routes: this.#routes,
      trailOf: (id) => this.#trails.of(id),
      goal: this.#picker.goal(),
      line: this.#picker.line(),
    }).draw();
  }
}

function placeOn(canvas: HTMLElement, { clientX, clientY }: MouseEvent): Pixel {
  const { left, top } = canvas.getBoundingClientRect();
  return [clientX - left, clientY - top];
}

export function MapInset({ map }: { map: FloorMap }) {
  const { link } = useSession();
  const { map: words } = texts().scene;
  if (!isOnFloor(link.robot.value) || link.robot.value === null) return null;
  if (!map.open.value)
    return (
      <div class="corner bl" data-covers>
        <button type="button" class="chip" aria-expanded="false" onClick={() => map.toggle()}>
          <Icon name="map" />
          {words.label}
        </button>
      </div>
    );
  const large = map.large.value;
  return (
    <section class={large ? "inset large" : "inset"} aria-label={words.label} data-covers>
      <header>
        <Icon name="map" />
        {words.label}
        <span class="spacer" />
        {large && <Zoom map={map} />}
        {map.away.value && (
          <Button icon="home" label={words.centre} onPress={() => (map.away.value = false)} />
        )}
        <Button
          icon="expand"
          class="enlarge"
          label={large ? words.smaller : words.larger}
          onPress={() => (map.large.value = !large)}
        />
        <Button icon="close" label={words.close} onPress={() => map.toggle()} />
      </header>
      <Canvas map={map} label={words.picture} />
    </section>
  );
}

function Zoom({ map }: { map: FloorMap }) {
  const { nearer, farther } = texts().scene.map;
  const press = (factor: number) => () => map.zoom(factor);
  return (
    <>
      <Button label={nearer} class="icon" onPress={press(BUTTON_ZOOM)}>
        +
      </Button>
      <Button label={farther} class="icon" onPress={press(1 / BUTTON_ZOOM)}>
        −
      </Button>
    </>
  );
}

function Canvas({ map, label }: { map: FloorMap; label: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => map.attach(canvas.current!), [map]);
  return <canvas ref={canvas} role="img" aria-label={label} />;
}
