// A table of figures: quantities down, modules or kinds of values across.

import type { ComponentChildren } from "preact";
import type { RobotInfo, RobotState } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";

interface TableProps {
  label: string;
  /** Heads of all columns; the first, of the names of the rows, may be empty. */
  heads: readonly string[];
  /** Name and cells of each row; one without a name shows pictures. */
  rows: readonly (readonly ComponentChildren[])[];
  pairs?: boolean;
}

export function Table({ label, heads, rows, pairs }: TableProps) {
  return (
    <table class={pairs ? "mods pairs" : "mods"} aria-label={label}>
      <thead>
        <tr>
          {heads.map((head, i) => (
            <th scope="col" key={i} class={i === 0 ? "note" : undefined}>
              {head || <span class="sr">{texts().panel.wheels.quantity}</span>}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map(([name, ...cells], i) => (
          <tr key={i} class={name ? undefined : "pic"}>
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

/** Figure with its unit, which an unknown figure has not; degrees follow without a space. */
export function value(
  number: number | null | undefined,
  decimals: number,
  unit: string,
  sign = false,
) {
  const text = figure(number, decimals, sign);
  if (unit === "" || typeof number !== "number") return text;
  if (unit === "°") return `${text}°`;
  return (
    <>
      {text}
      <span class="u">{unit}</span>
    </>
  );
}

/** Length of a push, negative for a wheel that turns backward. */
export function pushOf(velocity: readonly [number, number] | undefined, rpm = 1) {
  return velocity && Math.sign(rpm) * Math.hypot(...velocity);
}

interface ValuesProps {
  robot: RobotInfo;
  state: RobotState | null;
  /** What is looked at, in place of the set-points. */
  preview?: (Pick<RobotState, "joints"> & { twist: [number, number, number] }) | null;
}

/** Joints by name, or the components of the speed of a robot that has no joints. */
export function Values({ robot, state, preview = null }: ValuesProps) {
  const { wheels: words } = texts().panel;
  const rows =
    robot.joints.length > 0
      ? robot.joints.map(({ name, unit }, i) => {
          const goal = (preview ?? state)?.joints[i]?.setpoint;
          return [name, value(goal, 2, unit), value(state?.joints[i]?.value, 2, unit)];
        })
      : robot.twist_axes.map(({ symbol, unit }, i) => {
          const goal = (preview?.twist ?? state?.commanded)?.[i];
          return [symbol, value(goal, 2, unit), value(state?.twist?.[i], 2, unit)];
        });
  return (
    <Table label={words.title} heads={["", words.setPoint, words.measured]} rows={rows} pairs />
  );
}
