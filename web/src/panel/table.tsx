// Tables of figures: quantities down, modules or kinds of values across.

import type { ComponentChildren } from "preact";
import type * as wire from "../generated/wire";
import { useSession } from "../session";
import { currentState } from "../store/freshness";
import { figure, texts } from "../text/text";
import { Figure } from "../ui/figure";

/** Data of a robot for the panel. */
export interface Shown {
  robot: wire.RobotInfo;
  /** Null while the figures are not those of now. */
  state: wire.RobotState | null;
  /** Joints that are only looked at, in place of the set-points. */
  preview?: wire.JointPreview | null;
}

/** Robot in view and its state, or null without a robot. */
export function useShown(): Shown | null {
  const { link } = useSession();
  const robot = link.robot.value;
  return robot && { robot, state: currentState(link) };
}

/** A wheel, on its module if it has one. */
type Pose = Pick<wire.GimbalPose, "rpm" | "push"> & Partial<wire.GimbalPose>;

export interface Actuator {
  id: string;
  name: string;
  measured: (Pose & Partial<wire.GimbalState> & Partial<wire.WheelState>) | undefined;
  /** Set-point or preview. */
  goal: Pose | undefined;
}

export function actuatorsOf({ robot, state, preview }: Shown): Actuator[] {
  const { wheels: words } = texts().panel;
  if (robot.panel === "gimbals")
    return robot.modules.map((id, i) => {
      const measured = state?.modules[i];
      const goal = preview?.modules[i] ?? measured?.setpoint;
      return { id, name: words.module(i + 1), measured, goal };
    });
  return robot.wheels.map((id, i) => {
    const measured = state?.wheels[i];
    const set = measured && { rpm: measured.rpm_setpoint, push: measured.push_setpoint };
    const goal = preview?.wheels[i] ?? set;
    return { id, name: words.wheelNumber(i + 1), measured, goal };
  });
}

/** Length of a push; negative for a wheel that turns backward. */
export function pushOf({ push, rpm }: Pose): number {
  return Math.sign(rpm) * Math.hypot(...push);
}

/** Rows of figures, with a column for each pose; a wheel without a module has no angles. */
export function poseRows(poses: readonly (Pose | undefined)[], isGimbal: boolean): Row[] {
  const { wheels: words } = texts().panel;
  const rpm = poses.map((pose) => pose?.rpm);
  const push = quantity(words.push, "m/s", 2, ...poses.map((pose) => pose && pushOf(pose)));
  if (!isGimbal) return [quantity(words.rpm, "", 0, ...rpm), push];
  return [
    quantity(words.tilt, "°", 1, ...poses.map((pose) => pose?.tilt)),
    quantity("α", "°", 1, ...poses.map((pose) => pose?.alpha)),
    quantity("β", "°", 1, ...poses.map((pose) => pose?.beta)),
    push,
    quantity(words.wheel, words.rpm, 0, ...rpm),
  ];
}

export type Row = readonly ComponentChildren[];

export function quantity(
  name: ComponentChildren,
  unit: string,
  decimals: number,
  ...values: (number | null | undefined)[]
): Row {
  return [name, ...values.map((each) => value(each, decimals, unit))];
}

/** Figure with its unit, which an unknown one has not; degrees follow without a space. */
export function value(number: number | null | undefined, decimals: number, unit: string) {
  if (typeof number !== "number") return figure(number);
  if (unit === "°") return `${figure(number, decimals)}°`;
  return <Figure value={number} decimals={decimals} unit={unit} />;
}

interface TableProps {
  label: string;
  /** Heads of all columns; the first, above the row names, may be empty. */
  heads: Row;
  /** Name and cells of each row; one without a name shows pictures. */
  rows: readonly Row[];
}

export function Table({ label, heads, rows }: TableProps) {
  return (
    <table class="mods" aria-label={label}>
      <thead>
        <tr>
          {heads.map((head, i) => (
            <th scope="col" key={i}>
              {head || <span class="sr">{texts().panel.wheels.quantity}</span>}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map(([name, ...cells], i) => (
          <tr key={i}>
            {name ? <th scope="row">{name}</th> : <td />}
            {cells.map((cell, j) => (
              <td key={j}>{cell}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** Joints by name, or the components of the speed of a robot that has no joints. */
export function Values({ robot, state, preview }: Shown) {
  const { wheels: words } = texts().panel;
  const goals = (preview ?? state)?.joints;
  const twist = preview?.twist ?? state?.commanded;
  const joints = robot.joints.map(({ name, unit }, i) =>
    quantity(name, unit, 2, state?.joints[i]?.value, goals?.[i]?.setpoint),
  );
  const components = robot.twist_axes.map(({ symbol, unit }, i) =>
    quantity(symbol, unit, 2, state?.twist?.[i], twist?.[i]),
  );
  const rows = joints.length > 0 ? joints : components;
  return <Table label={words.title} heads={["", words.measured, words.setPoint]} rows={rows} />;
}
