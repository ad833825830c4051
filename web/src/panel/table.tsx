// A table of figures: quantities down, modules or kinds of values across.

import type { ComponentChildren } from "preact";
import type { JointPreview, RobotInfo, RobotState } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { texts } from "../text/text";
import { Figure } from "../ui/figure";

/** What the panel shows of a robot. */
export interface Shown {
  robot: RobotInfo;
  /** Null while the figures are not those of now. */
  state: RobotState | null;
  /** Joints that are only looked at, in place of the set-points. */
  preview?: JointPreview | null;
}

/** Robot in view and its state, or null without a robot. */
export function useShown(): Shown | null {
  const { link } = useSession();
  const robot = link.robot.value;
  if (robot === null || link.beat.value < 0) return null;
  return { robot, state: isCurrent(freshness(link)) ? link.state.value : null };
}

type Row = readonly ComponentChildren[];

interface TableProps {
  label: string;
  /** Heads of all columns; the first, of the names of the rows, may be empty. */
  heads: readonly string[];
  /** Name and cells of each row; one without a name shows pictures. */
  rows: readonly Row[];
  pairs?: boolean;
}

export function Table({ label, heads, rows, pairs }: TableProps) {
  return (
    <table class={pairs ? "mods pairs" : "mods"} aria-label={label}>
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

/** Row of one quantity: its name and its figures. */
export function quantity(
  name: ComponentChildren,
  unit: string,
  decimals: number,
  ...values: (number | null | undefined)[]
): Row {
  return [name, ...values.map((value) => <Figure value={value} decimals={decimals} unit={unit} />)];
}

/** Length of a push, negative for a wheel that turns backward. */
export function pushOf(velocity: readonly [number, number] | undefined, rpm = 1) {
  return velocity && Math.sign(rpm) * Math.hypot(...velocity);
}

/** Joints by name, or the components of the speed of a robot that has no joints. */
export function Values({ robot, state, preview }: Shown) {
  const { wheels: words } = texts().panel;
  const goals = (preview ?? state)?.joints;
  const twist = preview?.twist ?? state?.commanded;
  const rows =
    robot.joints.length > 0
      ? robot.joints.map(({ name, unit }, i) =>
          quantity(name, unit, 2, state?.joints[i]?.value, goals?.[i]?.setpoint),
        )
      : robot.twist_axes.map(({ symbol, unit }, i) =>
          quantity(symbol, unit, 2, state?.twist?.[i], twist?.[i]),
        );
  return (
    <Table label={words.title} heads={["", words.measured, words.setPoint]} rows={rows} pairs />
  );
}
