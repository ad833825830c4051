// Heading and place of the robot; for a sphere, how it is turned.

import type { ComponentChildren, JSX } from "preact";
import { isOnFloor } from "../drive/axes";
import type { SphereState } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { degrees, figure } from "../text/numbers";
import { texts } from "../text/text";
import { Figure } from "../ui/figure";

const TICKS = Array.from({ length: 12 }, (_, i) => 30 * i);

export function Heading() {
  const { link } = useSession();
  const { deck } = texts();
  void link.beat.value;
  const state = isCurrent(freshness(link)) ? link.state.value : null;
  if (!isOnFloor(link.robot.value)) {
    const sphere = state?.sphere ?? null;
    return (
      <Cell label={deck.turned} degrees={sphere && turnedBy(sphere)}>
        {["ωx", "ωy", "ωz"].map((name, i) => (
          <Row key={name} name={name} value={state?.twist?.[i]} unit="rad/s" />
        ))}
      </Cell>
    );
  }
  const [x, y, heading = null] = state?.pose ?? [];
  return (
    <Cell label={deck.heading} degrees={degrees(heading)} drawing={<Compass heading={heading} />}>
      <Row name="x" value={x} unit="m" />
      <Row name="y" value={y} unit="m" />
    </Cell>
  );
}

interface CellProps {
  label: string;
  degrees: number | null;
  drawing?: JSX.Element;
  children: ComponentChildren;
}

function Cell({ label, degrees: angle, drawing, children }: CellProps) {
  return (
    <div class="headcell">
      {drawing}
      <dl>
        <dt class="sr">{label}</dt>
        <dd class="big">{angle === null ? figure(angle) : `${figure(angle)}°`}</dd>
        {children}
      </dl>
    </div>
  );
}

function Row({ name, value, unit }: { name: string; value: number | undefined; unit: string }) {
  return (
    <>
      <dt>{name}</dt>
      <dd>
        <Figure value={value} decimals={2} unit={unit} />
      </dd>
    </>
  );
}

/** Needle to the front of the robot; x of the world is up. */
function Compass({ heading }: { heading: number | null }) {
  return (
    <svg class="compass" viewBox="-42 -42 84 84" aria-hidden="true">
      <circle class="st-rim" r="40" />
      {TICKS.map((at) => (
        <path key={at} class="tick" d="M0-40V-36" transform={`rotate(${at})`} />
      ))}
      <text class="st-t" y="-23">
        x
      </text>
      {heading !== null && (
        <path
          class="needle"
          d="M0-20L11 16L0 9L-11 16z"
          transform={`rotate(${(-heading * 180) / Math.PI})`}
        />
      )}
    </svg>
  );
}

/** Angle from the mounted orientation in degrees. */
function turnedBy({ wxyz: [w, x, y, z] }: SphereState): number | null {
  return degrees(2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w)));
}
