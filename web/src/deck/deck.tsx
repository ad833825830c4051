// Deck: five places at the bottom that never move. Stick, next step or speed, STOP, heading, turn.

import { useComputed } from "@preact/signals";
import { Fragment } from "preact";
import { isOnFloor } from "../drive/axes";
import { StopAll } from "../fleet/fleet";
import type { SphereState } from "../generated/wire";
import { useSession } from "../session";
import { currentState, freshness } from "../store/freshness";
import { degrees, figure, texts } from "../text/text";
import { Figure } from "../ui/figure";
import { Slot } from "./slot";
import { whyOff } from "./steps";
import { Stick, Turn } from "./stick";
import { StopCell } from "./stop_cell";
import "./deck.css";

export function Deck() {
  const session = useSession();
  const { deck } = texts();
  const { link, layout } = session;
  const kind = useComputed(() => freshness(link).kind).value;
  const off = useComputed(() => whyOff(session) !== null).value;
  if (layout.screen.value === "fleet")
    return (
      <section class="deck all" aria-label={deck.region}>
        <StopAll />
      </section>
    );
  const hasRobot = kind !== "starting" && kind !== "no_robot";
  const drives = hasRobot && kind !== "recorded";
  return (
    <section class={off ? "deck off" : "deck"} aria-label={deck.region}>
      <StopCell />
      {drives && <Stick />}
      <Slot />
      {hasRobot && <Heading />}
      {drives && <Turn />}
    </section>
  );
}

/** Heading and place of the robot; for a sphere, how it is turned. */
function Heading() {
  const { link } = useSession();
  const { deck } = texts();
  const { pose, twist, sphere } = currentState(link) ?? {};
  const onFloor = isOnFloor(link.robot.value);
  const angle = degrees(onFloor ? pose?.[2] : sphere && turnedBy(sphere));
  const [names, values] = onFloor ? [["x", "y"], pose] : [["ωx", "ωy", "ωz"], twist];
  return (
    <div class="headcell">
      {onFloor && <Compass degrees={angle} />}
      <dl>
        <dt class="sr">{onFloor ? deck.heading : deck.turned}</dt>
        <dd class="big">
          {figure(angle)}
          {angle !== null && "°"}
        </dd>
        {names.map((name, i) => (
          <Fragment key={name}>
            <dt>{name}</dt>
            <dd>
              <Figure value={values?.[i]} decimals={2} unit={onFloor ? "m" : "rad/s"} />
            </dd>
          </Fragment>
        ))}
      </dl>
    </div>
  );
}

/** Needle to the front of the robot; x of the world is up. */
function Compass({ degrees: angle }: { degrees: number | null }) {
  return (
    <svg class="compass" viewBox="-42 -42 84 84" aria-hidden="true">
      <circle class="st-rim" r="40" />
      <circle class="ticks" r="38" pathLength="12" />
      <text class="st-t" y="-23">
        x
      </text>
      {angle !== null && (
        <path class="needle" d="M0-20L11 16L0 9L-11 16z" transform={`rotate(${-angle})`} />
      )}
    </svg>
  );
}

/** Angle from the mounted orientation. */
function turnedBy({ wxyz: [w, x, y, z] }: SphereState): number {
  return 2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w));
}
