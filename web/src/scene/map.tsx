// Map: a small picture of the floor from above. A click on it plans a path, with the same request as
// a click in the scene; nothing moves.

import { computed, effect, signal, untracked } from "@preact/signals";
import { isOnFloor } from "../drive/axes";
import type { MapLines, MapRobot } from "../generated/wire";
import { type Session, useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { isFlag, remembered } from "../store/memory";
import { degrees, texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import { extended, fitting, lengthText, MapView, type Trail } from "./map_view";
import { Picker, PickLayer, type Point } from "./pick";

const WHEEL_PER_PX = 0.0015;
const LEAST_RADIUS_PX = 6;

export class FloorMap {
  readonly open;
  private readonly state;
  readonly large = signal(false);
  readonly view = new MapView();
  readonly picker: Picker;
  routes: MapLines["routes"] = {};
  trails: Record<string, Trail> = {};

  constructor({ link, path, layout }: Session) {
    const [wide, narrow] = [remembered("tsd-map", true, isFlag), signal(false)];
    this.state = computed(() => (layout.narrow.value ? narrow : wide));
    this.open = computed(() => this.state.value.value);
    this.picker = new Picker(path, {
      on: "floor",
      toPlace: (pixel, size) => this.view.toPlace(pixel, size),
      toPixel: (place, size) => this.view.toPixel(place, size),
    });
    link.on("map_lines", ({ routes, trails }) => {
      this.routes = routes;
      this.trails = trails ?? this.trails;
    });
    link.on("state", ({ map }) => {
      const isPicked = this.picker.stroke.peek().length > 0;
      for (const robot of map?.robots ?? []) {
        const { id } = robot;
        this.trails[id] = extended(this.trails[id] ?? [], placeOf(robot));
        if (id === link.robot.peek()?.id && !isPicked) this.view.follow(placeOf(robot));
      }
    });
    let on = false;
    effect(() => {
      const robot = link.welcome.value && link.robot.value; // After each connection.
      const isShown = robot !== null && isOnFloor(robot) && this.open.value;
      if (robot && (isShown || on)) link.send({ t: "map", on: (on = isShown) });
    });
  }

  toggle(): void {
    this.state.peek().value = !this.open.peek();
    this.large.value = false;
  }
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
  return (
    <section class={large ? "inset large" : "inset"} aria-label={words.label} data-covers>
      <header>
        <Icon name="map" />
        {words.label}
        <span class="spacer" />
        <Button class="zoom" children="+" label={words.nearer} onPress={() => map.view.zoom(2)} />
        <Button
          class="zoom"
          children="−"
          label={words.farther}
          onPress={() => map.view.zoom(0.5)}
        />
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

/**
 * The picture, in metres and drawn ten times a second. The style sheet has its colours. A robot is the
 * circle of its reach, with a tip that points forward.
 */
function Floor({ map: { view, trails, picker, routes } }: { map: FloorMap }) {
  const { link } = useSession();
  const { map: words } = texts().scene;
  void link.beat.value;
  const state = link.state.peek();
  const { robots = [], envelope = null } = state?.map ?? {};
  const stops = state?.stop_reaches ? "m-stops m-stops-reaches" : "m-stops";
  const shown = robots.find(({ id }) => id === link.robot.peek()?.id);
  const isStale = untracked(() => !isCurrent(freshness(link)));
  const ordered = [...robots].sort((a, b) => Number(a === shown) - Number(b === shown));
  const colours = new Map(link.welcome.value?.robots.map(({ id, colour }) => [id, colour]));
  const size = picker.size.value;
  const [px, span, step] = [view.scale(size), view.span.value, view.gridM()];
  const [x, y] = view.middle.value;
  const [right, down] = view.toPixel([0, 0], size).map((pixels) => `${pixels}px`);
  const grid = { "--right": right, "--down": down, "--step": `${step / px}px` };
  const others = robots.filter((robot) => robot !== shown); // The bar has the name of that one.
  const names = others.map(({ id, stale, pose: [atX, atY], reach_m }) => ({
    id,
    text: stale ? words.silent(id) : id,
    at: view.toPixel([atX - reach_m, atY], size),
  }));
  const zoom = (event: WheelEvent) => {
    event.preventDefault();
    view.zoom(Math.exp(-WHEEL_PER_PX * event.deltaY));
  };
  return (
    <div class="map" role="img" aria-label={words.picture} style={grid} onWheel={zoom}>
      <svg viewBox={`${-y - span / 2} ${-x - span / 2} ${span} ${span}`}>
        <g transform="matrix(0 -1 -1 0 0 0)">
          {envelope && shown && !isStale && (
            <path class={stops} d={`${pathOf(envelope)}Z`} transform={placed(shown)} />
          )}
          {robots.map(({ id }) => (
            <path key={id} class="m-trail" d={pathOf(trails[id] ?? [])} />
          ))}
          {Object.entries(routes).map(([id, points]) => (
            <path key={id} class="m-route" d={pathOf(points)} />
          ))}
          {ordered.map((robot) => {
            const isOld = robot.stale || isStale; // It may have moved since.
            const color = isOld ? null : colours.get(robot.id);
            const radius = Math.max(LEAST_RADIUS_PX * px, robot.reach_m);
            return (
              <g key={robot.id} class="m-robot" style={{ color }} transform={placed(robot)}>
                <circle r={radius} />
                <path d={`M${radius + 13 * px} 0l${-12 * px} ${5 * px}v${-10 * px}z`} />
              </g>
            );
          })}
        </g>
      </svg>
      {fitting(names, size).map(({ id, text, at: [left, top] }) => (
        <span
          key={id}
          class="m-name"
          style={{ left: `${left}px`, top: `${top}px`, borderColor: colours.get(id) }}
        >
          {text}
        </span>
      ))}
      <span class="m-bar">{lengthText(step)}</span>
      <span class="m-x">x ↑</span>
      <PickLayer picker={picker} />
    </div>
  );
}

/** Transform from the axes of a robot: x ahead, y to the left. */
function placed({ pose: [x, y, heading] }: MapRobot): string {
  return `translate(${x} ${y}) rotate(${degrees(heading)})`;
}

function placeOf({ pose: [x, y] }: MapRobot): Point {
  return [x, y];
}

function pathOf(points: Trail): string {
  const step = (point: Point, i: number) => `${points[i - 1] ? "L" : "M"}${point}`;
  return points.map((point, i) => (point === null ? "" : step(point, i))).join("");
}
