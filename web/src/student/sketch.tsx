// The robot of the setting from above, front up: how each wheel moves its pivot, and the point that
// the robot turns about.

import type { StudentFigures, StudentWheel } from "../generated/wire";
import { figure, texts } from "../text/text";

const HALF = 60;
const REACH = 42; // Extent of the wheels.
const ARROW = 18; // Length of the fastest arrow.

type Point = readonly [number, number];

/** Return a vector of the robot on the page, where its front is up: right and down. */
export function fromAbove([x, y]: Point, scale = 1): Point {
  return [-y * scale + 0, -x * scale + 0];
}

export function Sketch({ figures }: { figures: StudentFigures }) {
  const { student } = texts();
  const { wheels, radius_m: radius, centre, axis } = figures;
  const scale = REACH / (Math.max(...wheels.map(({ at }) => Math.hypot(...at))) + radius);
  const perMps = ARROW / Math.max(1e-9, ...wheels.map(({ push }) => Math.hypot(...push)));
  const pivots = wheels.map(({ at }) => fromAbove(at, scale));
  let caption = student.noCentre;
  if (centre) caption = student.centre(figure(Math.hypot(...centre), 2));
  if (axis) caption = student.axis(axis.map((part) => figure(part, 2)).join(", "));
  return (
    <figure class="sketch">
      <svg
        viewBox={`${-HALF} ${-HALF} ${2 * HALF} ${2 * HALF}`}
        role="img"
        aria-label={student.fromAbove}
      >
        <marker id="push-tip" orient="auto" markerUnits="userSpaceOnUse" overflow="visible">
          <path class="p-tip" d="M3 0L-1.5 2.5v-5z" />
        </marker>
        <path class="p-body" d={`M${pivots.join("L")}Z`} />
        <path class="p-front" d="M0-9l4 7h-8z" />
        {centre && <Centre at={fromAbove(centre, scale)} pivots={pivots} />}
        {wheels.map((wheel, i) => (
          <g key={i} transform={`translate(${pivots[i]})`}>
            <Wheel wheel={wheel} half={Math.max(4, radius * scale)} perMps={perMps} />
            <text y={Math.max(4, radius * scale) + 9}>{i + 1}</text>
          </g>
        ))}
      </svg>
      <figcaption>{caption}</figcaption>
    </figure>
  );
}

/** The centre of rotation; if it is far away, only the direction towards it. */
function Centre({ at: [right, down], pivots }: { at: Point; pivots: readonly Point[] }) {
  const share = Math.min(1, (HALF - 6) / Math.max(Math.abs(right), Math.abs(down), 1e-9));
  const at = [right * share, down * share];
  return (
    <>
      <path class="p-ray" d={pivots.map((pivot) => `M${pivot}L${at}`).join("")} />
      <g class={share < 1 ? "p-icr far" : "p-icr"} transform={`translate(${at})`}>
        <circle r="4" />
        <path d="M-6 0H6M0-6V6" />
      </g>
    </>
  );
}

/** A wheel with half its size; on gimbals it has an axle in place of a direction. */
function Wheel({ wheel, half, perMps }: { wheel: StudentWheel; half: number; perMps: number }) {
  const { push, direction_deg: direction, axle } = wheel;
  const [width, height] = direction === null ? [2 * half, 2 * half] : [half / 1.5, 2 * half];
  return (
    <>
      <rect
        class="p-mod"
        {...{ x: -width / 2, y: -half, width, height }}
        rx={direction === null ? half : 0}
        transform={`rotate(${-(direction ?? 0)})`}
      />
      {axle && <path class="d-axle" d={`M0 0L${fromAbove(axle, 3 * half)}`} />}
      {Math.hypot(...push) * perMps > 0.5 && (
        <path class="p-push" d={`M0 0L${fromAbove(push, perMps)}`} marker-end="url(#push-tip)" />
      )}
    </>
  );
}
