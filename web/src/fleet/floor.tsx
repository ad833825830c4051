// Floor map of all robots in one frame: x up, y to the left. Robots that are silent are pale.

import type { Fleet } from "../generated/wire";
import { useSession } from "../session";
import { texts } from "../text/text";

const SIZE = 288; // The map is at least this many pixels wide, so texts are never below 12 px.
const MARGIN = 30;
const LEAST_EXTENT_M = 3;

type Pose = Fleet["poses"][string];

/** Scale and place that show all poses; right and down in pixels. */
export function fitted(poses: readonly Pose[]) {
  const [xs, ys] = [poses.map(([x]) => x), poses.map(([, y]) => y)];
  const range = (values: number[]) => [Math.min(...values), Math.max(...values)] as const;
  const [[bottom, top], [right, left]] = [range(xs), range(ys)];
  const scale = (SIZE - 2 * MARGIN) / Math.max(top - bottom, left - right, LEAST_EXTENT_M);
  const place = ([x, y]: Pose) => ({
    right: SIZE / 2 + ((left + right) / 2 - y) * scale,
    down: SIZE / 2 + ((top + bottom) / 2 - x) * scale,
  });
  return { scale, place };
}

export function Floor() {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const poses = store.poses.value;
  const placed = store.rows.value.flatMap((row) => {
    const pose = poses[row.id];
    return pose && row.space === "floor" ? [{ row, pose }] : [];
  });
  if (placed.length === 0) return <p class="note">{fleet.noFloor}</p>;
  const { scale, place } = fitted(placed.map(({ pose }) => pose));
  const { right: x, down: y } = place([0, 0, 0]);
  const square = { x, y, width: scale, height: scale };
  return (
    <section class="sec">
      <h2>{fleet.floor}</h2>
      <svg class="floor" viewBox={`0 0 ${SIZE} ${SIZE}`} role="img" aria-label={fleet.floor}>
        <pattern id="floor-grid" patternUnits="userSpaceOnUse" {...square}>
          <path class="grid" d={`M0 ${scale}V0H${scale}`} />
        </pattern>
        <rect width={SIZE} height={SIZE} fill="url(#floor-grid)" />
        {placed.map(({ row, pose }) => {
          const { right, down } = place(pose);
          const degrees = (-pose[2] * 180) / Math.PI;
          return (
            <g
              key={row.id}
              class={row.silent ? "robot pale" : "robot"}
              style={{ "--c": row.colour }}
              transform={`translate(${right} ${down})`}
            >
              {row.latched && !row.silent && <circle class="halo" r="14" />}
              <circle class="body" r="9" />
              <path class="nose" d="M0-16l5 7h-10z" transform={`rotate(${degrees})`} />
              <text y="26">{row.id}</text>
            </g>
          );
        })}
        <path class="scale" d={`M12 ${SIZE - 12}h${scale}`} />
        <text x={12} y={SIZE - 18}>
          {fleet.metre("1")}
        </text>
      </svg>
      {placed.some(({ row }) => row.silent) && <p class="note">{fleet.pale}</p>}
    </section>
  );
}
