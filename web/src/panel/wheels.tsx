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
import { Dial, endOfAxle, ringRange, tipOf } from "./dial";
import { pushOf, Table, value, Values } from "./table";

const COLUMNS = 4; // Of one table; the next four follow below it.

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
      {robot.panel === "gimbals" && <Gimbals {...shown} />}
      {robot.wheels.length > 0 && <Wheels {...shown} />}
      {robot.panel !== "gimbals" && robot.wheels.length === 0 && <Values {...shown} />}
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
  const ring = (range.current = ringRange(tilts, range.current));
  const most = mostPush(robot, poses);
  const columns = robot.modules.map((_, i) => {
    const [pose, measured] = [poses?.[i], now?.[i]];
    const name = words.module(i + 1);
    const dial = (
      <Dial
        isAxle
        dot={measured ? endOfAxle(measured, ring) : null}
        ring={pose ? endOfAxle(pose, ring) : null}
        arrow={pose ? tipOf(pose.push, most) : null}
        looks={preview !== null}
        label={words.dial(name, figure(pose?.tilt, 1), figure(pose?.direction))}
      />
    );
    return [
      name,
      dial,
      <b class="lead">{value(pose?.tilt, 1, "°")}</b>,
      value(pose?.alpha, 1, "°", true),
      value(pose?.beta, 1, "°", true),
      value(pushOf(pose?.push), 2, "m/s"),
      value(pose?.rpm, 0, words.rpm),
    ];
  });
  const names = [words.ring(figure(ring)), "", words.tilt, "α", "β", words.push, words.wheel];
  const goal = preview ? words.looked : words.setPoint;
  return <Columns names={names} columns={columns} goal={goal} />;
}

function Wheels({ robot, state, preview }: Shown) {
  const words = texts().panel.wheels;
  const now = state?.wheels;
  const goals = now?.map(({ rpm_setpoint: rpm, push_setpoint: push }) => ({ rpm, push }));
  const poses = preview?.wheels ?? goals;
  const most = mostPush(robot, poses);
  const columns = robot.wheels.map((_, i) => {
    const [pose, measured] = [poses?.[i], now?.[i]];
    const name = words.wheelNumber(i + 1);
    const push = pose && pushOf(pose.push, pose.rpm);
    const dial = (
      <Dial
        isAxle={false}
        dot={measured ? tipOf(measured.push, most) : null}
        ring={null}
        arrow={pose ? tipOf(pose.push, most) : null}
        looks={preview !== null}
        label={words.wheelDial(name, figure(push, 2))}
      />
    );
    return [name, dial, value(push, 2, "m/s"), <b class="lead">{figure(pose?.rpm)}</b>];
  });
  return <Columns names={["", "", words.push, words.rpm]} columns={columns} goal={null} />;
}

/** Fastest push of a dial, in m/s: all of them have one scale. */
function mostPush(robot: RobotInfo, poses: readonly { push: [number, number] }[] = []): number {
  return Math.max(robot.limits.speed_mps, ...poses.map(({ push }) => Math.hypot(...push)));
}

interface ColumnsProps {
  /** Names of the rows, of which the first is that of the heads. */
  names: readonly string[];
  columns: readonly (readonly ComponentChildren[])[];
  /** What the ring of a dial is, if it has an axle. */
  goal: string | null;
}

function Columns({ names, columns, goal }: ColumnsProps) {
  const words = texts().panel.wheels;
  const tables = [];
  for (let i = 0; i < columns.length; i += COLUMNS) tables.push(columns.slice(i, i + COLUMNS));
  return (
    <>
      {tables.map((some, table) => {
        const [heads = [], ...rows] = names.map((name, i) => [name, ...some.map((one) => one[i])]);
        return <Table key={table} label={words.title} heads={heads as string[]} rows={rows} />;
      })}
      <p class="keys note">
        <span class="k-dot">{goal ? words.axle : words.measured}</span>
        {goal && <span class="k-set">{goal}</span>}
        <span class="k-push">{words.push}</span>
      </p>
    </>
  );
}

/** Share of the joint limit in use, and the limit that holds the robot back. */
function InUse({ robot, state, preview }: Shown) {
  const words = texts().panel.wheels;
  const { utilization = null, limit = null } = preview ?? state ?? {};
  const moves = preview !== null || state?.status.mode === "driving";
  const slowed = limit === "speed" || limit === "turn_rate" ? state?.status.limits.why : [];
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
        {slowed?.map((reason) => ` ${sentence(reason)}`)}
      </p>
    </>
  );
}
