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
import { MapPicture } from "./map_picture";
import { MapTrails, MapView, type Pixel } from "./map_view";
import { MIN_STEP_PX, Picker } from "./picker";

const WHEEL_PER_PX = 0.0015;
const BUTTON_ZOOM = 2;

const isSpan = (stored: unknown): stored is number => typeof stored === "number";

export class FloorMap {
  readonly open = remembered("tsd-map", !matchMedia("(max-width: 899px)").matches, isFlag);
  readonly large = signal(false);
  /** Whether it was moved away from the robot by hand. */
  readonly away = signal(false);
  /** Counts movements by hand, which are drawn at once. */
  readonly moves = signal(0);
  readonly view = new MapView();
  readonly trails = new MapTrails();
  readonly picker: Picker;
  routes: MapLines["routes"] = {};
  readonly #session: Session;
  readonly #span = remembered("tsd-map-span", this.view.spanM, isSpan);

  constructor(session: Session) {
    this.#session = session;
    const { link, path } = session;
    this.view.setSpan(this.#span.peek());
    this.picker = new Picker(path, {
      on: "floor",
      toPlace: (pixel) => this.view.toFloor(pixel),
      toPixel: (place) => this.view.toPixels(place),
    });
    link.on("map_lines", ({ routes, trails }) => {
      this.routes = routes;
      if (trails !== null) this.trails.replace(trails);
    });
    link.on("state", ({ map }) => map && this.trails.extend(map.robots));
    let on = false;
    effect(() => {
      const robot = link.welcome.value && link.robot.value; // After each connection.
      const isShown = robot !== null && isOnFloor(robot) && this.open.value;
      if (robot && (isShown || on)) link.send({ t: "map", on: (on = isShown) });
    });
  }

  toggle(): void {
    this.open.value = !this.open.peek();
    this.large.value = false;
  }

  zoom(factor: number, at?: Pixel): void {
    this.view.zoom(factor, at);
    this.#span.value = this.view.spanM;
    this.moves.value++;
  }

  /** Take the pointers of the picture; returns a function that ends it. */
  attach(node: Element & HTMLOrSVGElement): () => void {
    const pointer = this.#takePointer(node as HTMLElement);
    const ending = new AbortController();
    const wheel = (event: WheelEvent) => {
      event.preventDefault();
      this.zoom(Math.exp(-WHEEL_PER_PX * event.deltaY), placeOn(node, event));
    };
    node.addEventListener("wheel", wheel as EventListener, {
      passive: false,
      signal: ending.signal,
    });
    this.#takePinch(node, pointer, ending.signal);
    return () => {
      pointer.end();
      ending.abort();
    };
  }

  /** A click chooses a goal; a drag moves the picture, or turns the goal or draws in those modes. */
  #takePointer(node: HTMLElement): HeldPointer {
    const { path } = this.#session;
    let [first, last]: Pixel[] = [];
    return new HeldPointer(node, {
      came: (event) => {
        first = placeOn(node, event);
        last = undefined; // While it may still be a click.
        this.picker.begin(first);
      },
      moved: (event) => {
        const here = placeOn(node, event);
        if (path.mode.peek() !== "stick") return this.picker.move(here);
        const from = last ?? first ?? here;
        const by: Pixel = [here[0] - from[0], here[1] - from[1]];
        if (last === undefined && Math.hypot(...by) < MIN_STEP_PX) return;
        this.picker.cancel();
        this.view.pan(by);
        this.away.value = true;
        this.moves.value++;
        last = here;
      },
      gone: ({ type }) => (type === "pointerup" ? this.#pick() : this.picker.cancel()),
    });
  }

  #pick(): void {
    const { path } = this.#session;
    const before = path.wish.peek();
    this.picker.finish();
    // In that mode the goal can be turned by its handle.
    if (path.wish.peek() !== before && path.mode.peek() === "stick") path.choose("to");
  }

  /** Two fingers zoom; the second one ends what the first has begun. */
  #takePinch(node: Element, pointer: HeldPointer, signal: AbortSignal): void {
    const fingers = new Map<number, Pixel>();
    const take = (event: PointerEvent) => {
      const before = spreadOf(fingers);
      const stays = event.type === "pointerdown" || event.type === "pointermove";
      if (event.type === "pointermove" && !fingers.has(event.pointerId)) return;
      if (stays) fingers.set(event.pointerId, placeOn(node, event));
      else fingers.delete(event.pointerId);
      const [a, b] = [...fingers.values()];
      if (!a || !b) return;
      pointer.cancel();
      this.picker.cancel();
      const middle: Pixel = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
      if (before > 0) this.zoom(spreadOf(fingers) / before, middle);
    };
    for (const type of ["down", "move", "up", "cancel", "leave"])
      node.addEventListener(`pointer${type}`, take as EventListener, { signal });
  }
}

/** Distance of two fingers, or zero. */
function spreadOf(fingers: ReadonlyMap<number, Pixel>): number {
  const [a, b] = [...fingers.values()];
  return a && b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
}

function placeOn(node: Element, { clientX, clientY }: MouseEvent): Pixel {
  const { left, top } = node.getBoundingClientRect();
  return [clientX - left, clientY - top];
}

export function MapInset({ map }: { map: FloorMap }) {
  const { link } = useSession();
  const { map: words } = texts().scene;
  if (link.robot.value === null || !isOnFloor(link.robot.value)) return null;
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
  const zoom = (factor: number) => () => map.zoom(factor);
  return (
    <section class={large ? "inset large" : "inset"} aria-label={words.label} data-covers>
      <header>
        <Icon name="map" />
        {words.label}
        <span class="spacer" />
        {large && <Button children="+" label={words.nearer} onPress={zoom(BUTTON_ZOOM)} />}
        {large && <Button children="−" label={words.farther} onPress={zoom(1 / BUTTON_ZOOM)} />}
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
      <Floor map={map} />
    </section>
  );
}

/** The picture, drawn ten times a second and when a pointer draws on it. */
function Floor({ map }: { map: FloorMap }) {
  const { link } = useSession();
  const svg = useRef<SVGSVGElement>(null);
  useEffect(() => map.attach(svg.current!), [map]);
  useEffect(() => {
    const resized = new ResizeObserver(() => void map.moves.value++);
    resized.observe(svg.current!);
    return () => resized.disconnect();
  }, [map]);
  const { clientWidth: width, clientHeight: height } = svg.current ?? {};
  if (link.beat.value + map.moves.value >= 0 && width && height) map.view.size = { width, height };
  const state = link.state.peek()?.map;
  const robots = state?.robots ?? [];
  const shown = robots.find(({ id }) => id === link.robot.peek()?.id);
  if (shown && !map.away.value && map.picker.stroke.value.length === 0)
    map.view.follow([shown.pose[0], shown.pose[1]]);
  return (
    <svg ref={svg} class="map" role="img" aria-label={texts().scene.map.picture}>
      <MapPicture
        view={map.view}
        robots={robots}
        shown={shown}
        names={new Map(link.welcome.value?.robots.map((robot) => [robot.id, robot]))}
        isStale={untracked(() => !isCurrent(freshness(link)))}
        envelope={state?.envelope ?? null}
        routes={map.routes}
        trailOf={(id) => map.trails.of(id)}
        goal={map.picker.goal()}
        line={map.picker.line()}
      />
    </svg>
  );
}
