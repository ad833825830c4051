// What the modules or wheels do for the command: a dial each, and the figures of the inverse
// kinematics. While the sliders only look, those of the twist that is looked at.

import { useRef } from "preact/hooks";
import type { JointPreview } from "../generated/wire";
import { sentence } from "../text/reasons";
import { figure, texts } from "../text/text";
import { Dial, endOfAxle, ringRange, tipOf } from "./dial";
import type { Row, Shown } from "./table";
import { actuatorsOf, poseRows, pushOf, Table, useShown, Values } from "./table";

const COLUMNS = 4; // Per table; the next four wheels follow below.

export function WheelsDo({ preview }: { preview: JointPreview | null }) {
  const now = useShown();
  if (now === null) return null;
  const shown = { ...now, preview };
  const { robot, state } = shown;
  const words = texts().panel.wheels;
  const hasDials = robot.panel === "gimbals" || robot.wheels.length > 0;
  // Used fraction of the joint limit, and the limit that slows the robot.
  const { utilization = null, limit = null } = preview ?? state ?? {};
  const moves = preview !== null || state?.status.mode === "driving";
  const slowed = limit === "speed" || limit === "turn_rate" ? state?.status.limits.why : [];
  return (
    <section class={preview ? "sec looks" : "sec"}>
      <h2>
        {words.title}
        <small>{preview ? words.looked : words.setPoints}</small>
      </h2>
      {hasDials ? <Dials {...shown} /> : <Values {...shown} />}
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
    </section>
  );
}

function Dials(shown: Shown) {
  const range = useRef(0);
  const words = texts().panel.wheels;
  const actuators = actuatorsOf(shown);
  const isGimbal = shown.robot.panel === "gimbals";
  const goals = actuators.map(({ goal }) => goal);
  const tilts = actuators.flatMap(({ goal, measured }) => [goal?.tilt ?? 0, measured?.tilt ?? 0]);
  const ring = (range.current = ringRange(tilts, range.current));
  const pushes = goals.map((goal) => goal && pushOf(goal));
  const all = pushes.map((push = 0) => Math.abs(push));
  const most = Math.max(shown.robot.max_speed_mps, ...all); // All dials have one scale.
  const dials = actuators.map(({ name, measured, goal }, i) => (
    <Dial
      label={
        isGimbal
          ? words.dial(name, figure(goal?.tilt, 1), figure(goal?.direction))
          : words.wheelDial(name, figure(pushes[i], 2))
      }
      dot={measured && (isGimbal ? endOfAxle(measured, ring) : tipOf(measured.push, most))}
      goal={isGimbal ? goal && endOfAxle(goal, ring) : undefined}
      push={goal && tipOf(goal.push, most)}
    />
  ));
  const heads = [isGimbal ? words.ring(figure(ring)) : "", ...actuators.map(({ name }) => name)];
  const rows = [["", ...dials], ...poseRows(goals, isGimbal)];
  const starts = [...actuators.keys()].filter((i) => i % COLUMNS === 0);
  return (
    <>
      {starts.map((at) => {
        const part = ([name, ...cells]: Row) => [name, ...cells.slice(at, at + COLUMNS)];
        return <Table key={at} label={words.title} heads={part(heads)} rows={rows.map(part)} />;
      })}
      <p class="keys note">
        <span>{isGimbal ? words.axle : words.measured}</span>
        {isGimbal && <span class="k-set">{shown.preview ? words.looked : words.setPoint}</span>}
        <span class="k-push">{words.push}</span>
      </p>
    </>
  );
}
