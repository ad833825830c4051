// Floor map of all robots in one frame: x up, y to the left. Robots that are silent are pale.

import { useSession } from "../session";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import type { Row } from "./store";

const SIZE = 360;
const MARGIN = 36;
const LEAST_EXTENT_M = 3;

interface Placed {
  row: Row;
  pose: readonly [number, number, number];
}

/** Scale and centre that show all poses; right and down in pixels. */
export function fitted(poses: readonly (readonly [number, number, number])[]) {
  const range = (values: number[]) => {
    const [least, most] = [Math.min(...values), Math.max(...values)];
    return { centre: (least + most) / 2, extent: most - least };
  };
  const x = range(poses.map(([value]) => value));
  const y = range(poses.map(([, value]) => value));
  const extent = Math.max(x.extent, y.extent, LEAST_EXTENT_M);
  const scale = (SIZE - 2 * MARGIN) / extent;
  const place = ([px, py]: readonly [number, number, number]) => ({
    right: SIZE / 2 - (py - y.centre) * scale,
    down: SIZE / 2 - (px - x.centre) * scale,
  });
  return { scale, place, width: y.extent, height: x.extent };
}

export function Floor() {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const poses = store.poses.value;
  const placed: Placed[] = store.rows().flatMap((row) => {
    const pose = poses[row.id];
    return pose && row.space === "floor" ? [{ row, pose }] : [];
  });
  if (placed.length === 0) return <p class="note">{fleet.noFloor}</p>;
  const map = fitted(placed.map(({ pose }) => pose));
  const [width, height] = [figure(map.width, 1), figure(map.height, 1)];
  return (
    <section class="sec">
      <h2>
        {fleet.floor} <small>{fleet.extent(height, width)}</small>
      </h2>
      <svg class="floor" viewBox={`0 0 ${SIZE} ${SIZE}`} role="img" aria-label={fleet.floor}>
        <Grid step={map.scale} origin={map.place([0, 0, 0])} />
        {placed.map(({ row, pose }) => (
          <Marker key={row.id} row={row} at={map.place(pose)} heading={pose[2]} />
        ))}
        <path class="scale" d={`M12 ${SIZE - 12}h${map.scale}`} />
        <text x={12} y={SIZE - 18}>
          {fleet.metre("1")}
        </text>
      </svg>
      {placed.some(({ row }) => row.silent) && <p class="note">{fleet.pale}</p>}
    </section>
  );
}

function Grid({ step, origin }: { step: number; origin: { right: number; down: number } }) {
  const lines: string[] = [];
  for (let at = ((origin.right % step) + step) % step; at < SIZE; at += step)
    lines.push(`M${at} 0V${SIZE}`);
  for (let at = ((origin.down % step) + step) % step; at < SIZE; at += step)
    lines.push(`M0 ${at}H${SIZE}`);
  return <path class="grid" d={lines.join("")} />;
}

interface MarkerProps {
  row: Row;
  at: { right: number; down: number };
  heading: number;
}

function Marker({ row, at, heading }: MarkerProps) {
  const classes = ["robot", row.silent && "pale", row.latched && !row.silent && "needs"];
  return (
    <g
      class={classes.filter(Boolean).join(" ")}
      style={{ "--c": row.colour }}
      transform={`translate(${at.right} ${at.down})`}
    >
      {row.latched && !row.silent && <circle class="halo" r="14" />}
      <circle class="body" r="9" />
      <path class="nose" d="M0-16l5 7h-10z" transform={`rotate(${(-heading * 180) / Math.PI})`} />
      <text y="26">{row.id}</text>
    </g>
  );
}
