// Drawing of the map. The style sheet has its colours.

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
  /** Whether it does not show the robots of now. */
  isStale: boolean;
  envelope: readonly Point[] | null;
  routes: Record<string, readonly Point[]>;
  trailOf: (id: string) => readonly (Point | null)[];
  goal: Goal | null;
  line: readonly Pixel[];
}

const LEAST_RADIUS_PX = 6;
const MARGIN_PX = 10;
const LETTER_PX = 7; // Mean width of a letter.

export function MapPicture({ view, ...content }: MapContent & { view: MapView }) {
  const { robots, shown, envelope, routes, trailOf, goal, line, isStale } = content;
  const { width, height } = view.size;
  const ordered = [...robots].sort((a, b) => Number(a === shown) - Number(b === shown));
  const low = height - MARGIN_PX;
  const bar = view.barM() * view.scale;
  return (
    <>
      <path class="m-grid" d={gridOf(view)} />
      {envelope && shown && !isStale && (
        <path class="m-stops" d={`${pathOf(view, aroundOf(shown, envelope))}Z`} />
      )}
      {robots.map(({ id }) => (
        <path key={id} class="m-trail" d={pathOf(view, trailOf(id))} />
      ))}
      {Object.entries(routes).map(([id, points]) => (
        <path key={id} class="m-route" d={pathOf(view, points)} />
      ))}
      {ordered.map((robot) => (
        <Robot key={robot.id} view={view} content={content} robot={robot} />
      ))}
      {content.names.size > 1 && <Names view={view} content={content} />}
      <polyline class="pick-line" points={line.map((pixel) => pixel.join()).join(" ")} />
      {goal && <GoalMark goal={goal} />}
      <path class="m-bar" d={`M${MARGIN_PX} ${low - 5}V${low}h${bar}v-5`} />
      <text x={MARGIN_PX + 5} y={low - 6}>
        {lengthText(view.barM())}
      </text>
      <text x={width - MARGIN_PX} y={MARGIN_PX + 8} text-anchor="end">
        x ↑
      </text>
    </>
  );
}

/** A goal with the handle that turns it. */
export function GoalMark({ goal: { at, handle, turns } }: { goal: Goal }) {
  return (
    <g class={turns ? "pick-goal turns" : "pick-goal"}>
      <path d={`M${at.join()}L${handle.join()}`} />
      <circle cx={at[0]} cy={at[1]} r={7} />
      <circle class="handle" cx={handle[0]} cy={handle[1]} r={7} />
    </g>
  );
}

interface RobotProps {
  view: MapView;
  content: MapContent;
  robot: MapRobot;
}

/** Circle of a robot's reach, with a tip that points forward: x of the world is up, y is left. */
function Robot({ view, content, robot }: RobotProps) {
  const { at, radius } = circleOf(view, robot);
  const isOld = robot.stale || content.isStale;
  const color = isOld ? undefined : content.names.get(robot.id)?.colour;
  const degrees = (-robot.pose[2] * 180) / Math.PI;
  return (
    <g
      class={isOld ? "m-robot old" : "m-robot"}
      style={{ color }}
      transform={`translate(${at.join()}) rotate(${degrees})`}
    >
      <circle r={radius} />
      <path d={`M0 ${-radius - 13}l5 12h-10z`} />
    </g>
  );
}

/** Names next to the robots, underlined in their colours; the displayed robot has priority. */
function Names({ view, content }: Omit<RobotProps, "robot">) {
  const { robots, shown, names } = content;
  const ordered = [...robots].sort((a, b) => Number(b === shown) - Number(a === shown));
  const labels = ordered.map((robot) => {
    const text = robot.stale ? texts().scene.map.silent(robot.id) : robot.id;
    return { id: robot.id, text, ...circleOf(view, robot), width: LETTER_PX * text.length };
  });
  const places = labelPlaces(labels, [0, view.size.width]);
  return labels.map(({ id, text, width }, i) => {
    const [x, y] = places[i]!;
    return (
      <g key={id} class="m-name" style={{ color: names.get(id)?.colour }}>
        <text x={x} y={y}>
          {text}
        </text>
        <path d={`M${x - width / 2} ${y + 4}h${width}`} />
      </g>
    );
  });
}

function circleOf(view: MapView, { pose: [x, y], reach_m }: MapRobot) {
  return { at: view.toPixels([x, y]), radius: Math.max(LEAST_RADIUS_PX, reach_m * view.scale) };
}

/** Points in the world of points around a robot. */
function aroundOf({ pose: [x, y, heading] }: MapRobot, points: readonly Point[]): Point[] {
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return points.map(([a, b]) => [x + c * a - s * b, y + s * a + c * b]);
}

function pathOf(view: MapView, points: readonly (Point | null)[]): string {
  const step = (point: Point, i: number) => {
    const [right, down] = view.toPixels(point);
    return `${i === 0 || points[i - 1] === null ? "M" : "L"}${right.toFixed(1)} ${down.toFixed(1)}`;
  };
  return points.map((point, i) => (point === null ? "" : step(point, i))).join("");
}

function gridOf(view: MapView): string {
  const { width, height } = view.size;
  const step = view.gridM();
  const [topX, leftY] = view.toFloor([0, 0]);
  const [lowX, rightY] = view.toFloor([width, height]);
  let grid = "";
  for (let x = Math.ceil(lowX / step) * step; x <= topX; x += step)
    grid += `M0 ${view.toPixels([x, 0])[1].toFixed(1)}H${width}`;
  for (let y = Math.ceil(rightY / step) * step; y <= leftY; y += step)
    grid += `M${view.toPixels([0, y])[0].toFixed(1)} 0V${height}`;
  return grid;
}

/** Length in metres or centimetres, for the scale bar. */
export function lengthText(metres: number): string {
  return metres < 0.995 ? `${figure(100 * metres)} cm` : `${figure(metres)} m`;
}
