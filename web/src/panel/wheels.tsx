// What the modules or wheels do for the command: a dial each, and the figures of the inverse
// kinematics. While the sliders only look, those of the twist that is looked at.

import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import type { JointPreview, RobotInfo, RobotState } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { figure } from "../text/numbers";
import { sentence } from "../text/reasons";
import { texts } from "../text/text";
import { Figure } from "../ui/figure";
import { Dial, endOfAxle, ringRange, tipOf } from "./dial";

const COLUMNS = 4; // Of one table; the next four follow below it.

interface Column {
  name: string;
  dial: ComponentChildren;
  cells: readonly ComponentChildren[];
}

interface Shown {
  robot: RobotInfo;
  /** Null while the figures are not those of now. */
  state: RobotState | null;
  preview: JointPreview | null;
}

export function WheelsDo({ preview }: { preview: JointPreview | null }) {
  const { link } = useSession();
  const robot = link.robot.value;
  const latest = link.state.value;
  if (robot === null || link.beat.value < 0) return null;
  const shown = { robot, state: isCurrent(freshness(link)) ? latest : null, preview };
  const words = texts().panel.wheels;
  return (
    <section class={preview ? "sec looks" : "sec"}>
      <h2>
        {words.title}
        <small>{preview ? words.looked : words.setPoints}</small>
      </h2>
      {robot.panel === "gimbals" ? (
        <Gimbals {...shown} />
      ) : robot.wheels.length > 0 ? (
        <Wheels {...shown} />
      ) : (
        <Values {...shown} />
      )}
      <InUse {...shown} />
    </section>
  );
}

function Gimbals({ robot, state, preview }: Shown) {
  const range = useRef(0);
  const words = texts().panel.wheels;
  const now = state?.modules;
  const poses = preview?.modules ?? now?.map(({ setpoint }) => setpoint);
  const tilts = [...(now ?? []), ...(poses ?? [])].map(({ tilt }) => tilt);
  range.current = ringRange(tilts, range.current);
  const most = mostPush(robot, poses);
  const columns = robot.modules.map((_, i): Column => {
    const [pose, measured] = [poses?.[i], now?.[i]];
    const name = words.module(i + 1);
    return {
      name,
      dial: (
        <Dial
          isAxle
          dot={measured ? endOfAxle(measured, range.current) : null}
          ring={pose ? endOfAxle(pose, range.current) : null}
          arrow={pose ? tipOf(pose.push, most) : null}
          looks={preview !== null}
          label={words.dial(name, figure(pose?.tilt, 1), figure(pose?.direction))}
        />
      ),
      cells: [
        <b class="lead">
          <Figure value={pose?.tilt} decimals={1} />°
        </b>,
        `${figure(pose?.alpha, 1, true)}°`,
        `${figure(pose?.beta, 1, true)}°`,
        <Figure value={pose && Math.hypot(...pose.push)} decimals={2} unit="m/s" />,
        <Figure value={pose?.rpm} unit={words.rpm} />,
      ],
    };
  });
  const rows = [words.tilt, "α", "β", words.push, words.wheel];
  return (
    <Columns corner={words.ring(figure(range.current))} rows={rows} columns={columns} isAxle />
  );
}

function Wheels({ robot, state, preview }: Shown) {
  const words = texts().panel.wheels;
  const now = state?.wheels;
  const poses =
    preview?.wheels ??
    now?.map(({ rpm_setpoint, push_setpoint: push }) => ({ rpm: rpm_setpoint, push }));
  const most = mostPush(robot, poses);
  const columns = robot.wheels.map((_, i): Column => {
    const [pose, measured] = [poses?.[i], now?.[i]];
    const name = words.wheelNumber(i + 1);
    const push = pose && Math.sign(pose.rpm) * Math.hypot(...pose.push);
    return {
      name,
      dial: (
        <Dial
          isAxle={false}
          dot={measured ? tipOf(measured.push, most) : null}
          ring={null}
          arrow={pose ? tipOf(pose.push, most) : null}
          looks={preview !== null}
          label={words.wheelDial(name, figure(push, 2))}
        />
      ),
      cells: [
        <Figure value={push} decimals={2} unit="m/s" />,
        <b class="lead">
          <Figure value={pose?.rpm} />
        </b>,
      ],
    };
  });
  return <Columns corner="" rows={[words.push, words.rpm]} columns={columns} isAxle={false} />;
}

/** Fastest push of a dial, in m/s: all of them have one scale. */
function mostPush(robot: RobotInfo, poses: readonly { push: [number, number] }[] = []): number {
  return Math.max(robot.limits.speed_mps, ...poses.map(({ push }) => Math.hypot(...push)));
}

interface ColumnsProps {
  corner: string;
  rows: readonly string[];
  columns: readonly Column[];
  isAxle: boolean;
}

function Columns({ corner, rows, columns, isAxle }: ColumnsProps) {
  const words = texts().panel.wheels;
  const tables = [];
  for (let i = 0; i < columns.length; i += COLUMNS) tables.push(columns.slice(i, i + COLUMNS));
  return (
    <>
      {tables.map((some) => (
        <table class="mods" key={some[0]?.name} aria-label={words.title}>
          <thead>
            <tr>
              <th scope="col" class="note">
                {corner || <span class="sr">{words.quantity}</span>}
              </th>
              {some.map(({ name }) => (
                <th scope="col" key={name}>
                  {name}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            <tr class="pic">
              <td />
              {some.map(({ name, dial }) => (
                <td key={name}>{dial}</td>
              ))}
            </tr>
            {rows.map((row, i) => (
              <tr key={row}>
                <th scope="row">{row}</th>
                {some.map(({ name, cells }) => (
                  <td key={name}>{cells[i]}</td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      ))}
      <p class="keys note">
        <span class="k-dot">{isAxle ? words.axle : words.measured}</span>
        {isAxle && <span class="k-set">{words.setPoint}</span>}
        <span class="k-push">{words.push}</span>
      </p>
    </>
  );
}

/** Rows of a robot without dials: joints by name, or the speeds of a robot that has no joints. */
export function Values({ robot, state, preview }: Shown) {
  const { wheels: words, modules } = texts().panel;
  const joints = preview?.joints ?? state?.joints;
  const rows =
    robot.joints.length > 0
      ? robot.joints.map(({ name, unit }, i) => {
          const { setpoint = null } = joints?.[i] ?? {};
          return { name, unit, setpoint, value: state?.joints[i]?.value };
        })
      : robot.twist_axes.map(({ symbol, unit }, i) => {
          const setpoint = (preview?.twist ?? state?.commanded)?.[i];
          return { name: symbol, unit, setpoint, value: state?.twist?.[i] };
        });
  return (
    <table class="mods" aria-label={words.title}>
      <thead>
        <tr>
          {[words.quantity, modules.setPoint, modules.measured].map((head, i) => (
            <th scope="col" key={head}>
              {i === 0 ? <span class="sr">{head}</span> : head}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map(({ name, unit, setpoint, value }) => (
          <tr key={name}>
            <th scope="row">{name}</th>
            <td>
              <Figure value={setpoint} decimals={2} unit={unit} />
            </td>
            <td>
              <Figure value={value} decimals={2} unit={unit} />
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** Share of the joint limit in use, and the limit that holds the robot back. */
function InUse({ robot, state, preview }: Shown) {
  const words = texts().panel.wheels;
  const { utilization = null, limit = null } = preview ?? state ?? {};
  const moves = preview !== null || state?.status.mode === "driving";
  const why = state?.status.limits.why ?? [];
  const isSpeed = limit === "speed" || limit === "turn_rate";
  return (
    <>
      {utilization !== null && (
        <p class={utilization > 1 ? "used warn" : "used"}>
          {robot.panel === "gimbals" ? words.usedTilt : words.usedSpeed}
          <b>{figure(100 * utilization)} %</b>
        </p>
      )}
      <p class={limit ? "held warn" : "held note"}>
        {limit ? words.heldBack[limit] : moves && words.nothingHeld}
        {isSpeed && why.map((reason) => ` ${sentence(reason)}`)}
      </p>
    </>
  );
}
