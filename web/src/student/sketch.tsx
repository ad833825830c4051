// The robot of the setting from above, front up: how each wheel moves its pivot, and the point that
// the robot turns about.

import type { StudentFigures, StudentWheel } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";

const HALF = 60;
const REACH = 42; // Extent of the wheels.
const ARROW = 18; // Length of the fastest arrow.

type Point = readonly [number, number];

/** Return a vector of the robot on the page, where its front is up: right and down. */
export function fromAbove([x, y]: Point, scale = 1): [number, number] {
  return [-y * scale + 0, -x * scale + 0];
}

const text = (point: Point, scale: number) =>
  fromAbove(point, scale)
    .map((part) => part.toFixed(2))
    .join(" ");

export function Sketch({ figures }: { figures: StudentFigures }) {
  const { student } = texts();
  const { wheels, radius_m: radius, centre } = figures;
  const far = Math.max(...wheels.map(({ at: [x, y] }) => Math.hypot(x, y))) + radius;
  const fast = Math.max(1e-9, ...wheels.map(({ push: [x, y] }) => Math.hypot(x, y)));
  const scale = REACH / far;
  const body = `M${wheels.map(({ at }) => text(at, scale)).join("L")}Z`;
  return (
    <figure class="sketch">
      <svg
        viewBox={`${-HALF} ${-HALF} ${2 * HALF} ${2 * HALF}`}
        role="img"
        aria-label={student.fromAbove}
      >
        <path class="p-body" d={body} />
        <path class="p-front" d="M0-9l4 7h-8z" />
        {centre && <Centre centre={centre} scale={scale} wheels={wheels} />}
        {wheels.map((wheel, i) => (
          <Wheel key={i} {...{ wheel, scale, radius }} number={i + 1} perMps={ARROW / fast} />
        ))}
      </svg>
      <figcaption>{caption(figures)}</figcaption>
    </figure>
  );
}

function caption({ centre, axis }: StudentFigures): string {
  const { student } = texts();
  if (axis) return student.axis(axis.map((part) => figure(part, 2)).join(", "));
  return centre ? student.centre(figure(Math.hypot(...centre), 2)) : student.noCentre;
}

interface CentreProps {
  centre: Point;
  scale: number;
  wheels: readonly StudentWheel[];
}

/** The centre of rotation; if it is far away, only the direction towards it. */
function Centre({ centre, scale, wheels }: CentreProps) {
  const [right, down] = fromAbove(centre, scale);
  const share = Math.min(1, (HALF - 6) / Math.max(Math.abs(right), Math.abs(down), 1e-9));
  const at = `${(right * share).toFixed(2)} ${(down * share).toFixed(2)}`;
  return (
    <g>
      {wheels.map((wheel, i) => (
        <path key={i} class="p-ray" d={`M${text(wheel.at, scale)}L${at}`} />
      ))}
      <g class={share < 1 ? "p-icr far" : "p-icr"} transform={`translate(${at})`}>
        <circle r="4" />
        <path d="M-6 0H6M0-6V6" />
      </g>
    </g>
  );
}

interface WheelProps {
  wheel: StudentWheel;
  number: number;
  scale: number;
  radius: number;
  perMps: number;
}

function Wheel({ wheel, number, scale, radius, perMps }: WheelProps) {
  const { at, push, direction_deg: direction, axle } = wheel;
  const wide = Math.max(4, radius * scale);
  const [right, down] = fromAbove(push, perMps);
  const angle = (Math.atan2(right, -down) * 180) / Math.PI;
  const length = Math.hypot(right, down);
  return (
    <g transform={`translate(${text(at, scale)})`}>
      {direction === null ? (
        <circle class="p-mod" r={wide} />
      ) : (
        <rect
          class="p-mod"
          x={-wide / 3}
          y={-wide}
          width={wide / 1.5}
          height={2 * wide}
          transform={`rotate(${-direction})`}
        />
      )}
      {axle && <path class="d-axle" d={`M0 0L${text(axle, 3 * wide)}`} />}
      {length > 0.5 && (
        <path
          class="p-push"
          d={`M0 0V${-length}M0 ${-length - 3}l2.5 4.5h-5z`}
          transform={`rotate(${angle})`}
        />
      )}
      <text y={wide + 9}>{number}</text>
    </g>
  );
}
