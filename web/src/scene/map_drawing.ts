// Drawing of the map on its canvas, in the colours of the page.

import type { MapRobot } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { labelPlaces, type MapView, type Pixel, type Point } from "./map_view";
import type { Goal } from "./picker";

export interface MapContent {
  robots: readonly MapRobot[];
  /** The robot in view, which is drawn on top and has the stop envelope. */
  shown: MapRobot | undefined;
  /** Title and colour by id. */
  names: ReadonlyMap<string, { title: string; colour: string }>;
  /** Whether the picture is not of now. */
  isStale: boolean;
  envelope: readonly Point[] | null;
  routes: Record<string, readonly Point[]>;
  trailOf: (id: string) => readonly (Point | null)[];
  goal: Goal | null;
  line: readonly Pixel[];
}

const COLOURS = {
  ink: "--ink-2",
  line: "--line",
  edge: "--edge",
  ground: "--sunken",
  estimate: "--estimate",
  plan: "--plan",
  caution: "--caution",
  stale: "--ink-3",
} as const;
type Colour = keyof typeof COLOURS;

const LEAST_RADIUS_PX = 6;
const MARGIN_PX = 10;
const DOT_PX = 6;

export class MapDrawing {
  readonly #pen: CanvasRenderingContext2D;
  readonly #view: MapView;
  readonly #content: MapContent;
  readonly #colours: Record<Colour, string>;

  constructor(pen: CanvasRenderingContext2D, view: MapView, content: MapContent) {
    this.#pen = pen;
    this.#view = view;
    this.#content = content;
    const style = getComputedStyle(pen.canvas);
    const named = Object.entries(COLOURS).map(([name, token]) => [
      name,
      style.getPropertyValue(token),
    ]);
    this.#colours = Object.fromEntries(named) as Record<Colour, string>;
    pen.font = `600 12px ${style.getPropertyValue("--font") || "sans-serif"}`;
    pen.lineJoin = pen.lineCap = "round";
  }

  draw(): void {
    const { robots, shown, routes, names, goal, line, trailOf } = this.#content;
    const { width, height } = this.#view.size;
    this.#pen.clearRect(0, 0, width, height);
    this.#grid();
    this.#envelope();
    for (const { id } of robots) {
      this.#path(trailOf(id));
      this.#stroke("estimate", 2);
    }
    for (const points of Object.values(routes)) {
      this.#path(points);
      this.#stroke("plan", 3, [10, 5]);
      const end = points.at(-1);
      if (end) this.#dot(this.#view.toPixels(end), DOT_PX, "plan");
    }
    for (const robot of robots) if (robot !== shown) this.#robot(robot);
    if (shown) this.#robot(shown);
    if (names.size > 1) this.#names();
    this.#line(line);
    this.#stroke("plan", 3);
    if (goal) this.#goal(goal);
    this.#scale();
  }

  #grid(): void {
    const { width, height } = this.#view.size;
    const step = this.#view.gridM();
    const [topX, topY] = this.#view.toFloor([0, 0]);
    const [lowX, lowY] = this.#view.toFloor([width, height]);
    for (let x = Math.ceil(lowX / step) * step; x <= topX; x += step) {
      const [, down] = this.#view.toPixels([x, 0]);
      this.#line([
        [0, down],
        [width, down],
      ]);
      this.#stroke(x === 0 ? "edge" : "line", 1);
    }
    for (let y = Math.ceil(lowY / step) * step; y <= topY; y += step) {
      const [right] = this.#view.toPixels([0, y]);
      this.#line([
        [right, 0],
        [right, height],
      ]);
      this.#stroke(y === 0 ? "edge" : "line", 1);
    }
  }

  #envelope(): void {
    const { envelope, shown, isStale } = this.#content;
    if (envelope === null || shown === undefined || isStale) return;
    const [x, y, heading] = shown.pose;
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    this.#path(envelope.map(([a, b]) => [x + c * a - s * b, y + s * a + c * b]));
    this.#pen.closePath();
    this.#fill("caution", 0.2);
    this.#stroke("caution", 2, [5, 4]);
  }

  #robot(robot: MapRobot): void {
    const { names, isStale } = this.#content;
    const heading = robot.pose[2];
    const { at, radius } = this.#circle(robot);
    const own = robot.stale || isStale ? undefined : names.get(robot.id)?.colour;
    const colour = own ?? this.#colours[robot.stale || isStale ? "stale" : "estimate"];
    // The tip points forward: x of the world is up, y is left.
    const [s, c] = [Math.sin(heading), Math.cos(heading)];
    const corner = (ahead: number, left: number): Pixel => [
      at[0] - ahead * s - left * c,
      at[1] - ahead * c + left * s,
    ];
    const pen = this.#pen;
    pen.beginPath();
    pen.arc(...at, radius, 0, 2 * Math.PI);
    this.#fill(colour, 0.35);
    this.#stroke(colour, 2);
    this.#line([corner(radius + 9, 0), corner(radius + 1, 6), corner(radius + 1, -6)]);
    pen.closePath();
    this.#fill(colour);
  }

  #circle({ pose: [x, y], reach_m }: MapRobot): { at: Pixel; radius: number } {
    const radius = Math.max(LEAST_RADIUS_PX, reach_m * this.#view.scale);
    return { at: this.#view.toPixels([x, y]), radius };
  }

  /** Names next to the robots; the displayed robot has priority. */
  #names(): void {
    const { names, robots, shown } = this.#content;
    const ordered = [...robots].sort((a, b) => Number(b === shown) - Number(a === shown));
    const labels = ordered.map((robot) => {
      const title = names.get(robot.id)?.title ?? robot.id;
      const text = robot.stale ? texts().scene.map.silent(title) : title;
      return { text, ...this.#circle(robot), width: this.#pen.measureText(text).width };
    });
    this.#pen.textAlign = "center";
    labelPlaces(labels, [0, this.#view.size.width]).forEach(([x, y], i) => {
      const { text = "", width = 0 } = labels[i] ?? {};
      this.#text(text, x, y);
      this.#pen.fillStyle = names.get(ordered[i]?.id ?? "")?.colour ?? this.#colours.estimate;
      this.#pen.fillRect(x - width / 2, y + 3, width, 2); // In the robot's colour.
    });
  }

  #goal({ at, handle, turns }: Goal): void {
    this.#line([at, handle]);
    this.#stroke("plan", 2, turns ? [] : [3, 4]);
    this.#dot(at, DOT_PX, "plan");
    this.#dot(handle, DOT_PX, turns ? "plan" : "ground");
  }

  /** Scale bar and the direction of x, in the lower corners. */
  #scale(): void {
    const { height, width } = this.#view.size;
    const low = height - MARGIN_PX;
    const to = MARGIN_PX + this.#view.barM() * this.#view.scale;
    this.#line([
      [MARGIN_PX, low - 5],
      [MARGIN_PX, low],
      [to, low],
      [to, low - 5],
    ]);
    this.#stroke("ink", 2);
    this.#pen.textAlign = "left";
    this.#text(lengthText(this.#view.barM()), MARGIN_PX + 5, low - 6);
    this.#pen.textAlign = "right";
    this.#text("x ↑", width - MARGIN_PX, MARGIN_PX + 8);
  }

  #text(text: string, right: number, down: number): void {
    this.#pen.lineWidth = 3;
    this.#pen.strokeStyle = this.#colours.ground; // Readable on lines and robots.
    this.#pen.strokeText(text, right, down);
    this.#pen.fillStyle = this.#colours.ink;
    this.#pen.fillText(text, right, down);
  }

  #path(points: readonly (Point | null)[]): void {
    this.#pen.beginPath();
    let isNew = true;
    for (const point of points) {
      if (point !== null && isNew) this.#pen.moveTo(...this.#view.toPixels(point));
      else if (point !== null) this.#pen.lineTo(...this.#view.toPixels(point));
      isNew = point === null;
    }
  }

  #line(pixels: readonly Pixel[]): void {
    this.#pen.beginPath();
    for (const pixel of pixels) this.#pen.lineTo(...pixel);
  }

  #dot(at: Pixel, radius: number, colour: Colour): void {
    this.#pen.beginPath();
    this.#pen.arc(...at, radius, 0, 2 * Math.PI);
    this.#fill(colour);
    this.#stroke(colour === "plan" ? "ground" : "plan", 2);
  }

  #stroke(colour: Colour | string, width: number, dashes: number[] = []): void {
    this.#pen.strokeStyle = this.#colours[colour as Colour] ?? colour;
    this.#pen.lineWidth = width;
    this.#pen.setLineDash(dashes);
    this.#pen.stroke();
    this.#pen.setLineDash([]);
  }

  #fill(colour: Colour | string, opacity = 1): void {
    this.#pen.globalAlpha = opacity;
    this.#pen.fillStyle = this.#colours[colour as Colour] ?? colour;
    this.#pen.fill();
    this.#pen.globalAlpha = 1;
  }
}

/** Length in metres or centimetres, for the scale bar. */
export function lengthText(metres: number): string {
  const { map } = texts().scene;
  if (metres < 0.995) return map.centimetres(figure(100 * metres));
  return map.metres(figure(metres));
}
