// What the modules or wheels do for the command: a dial each, and the figures of the inverse
// kinematics. While the sliders only look, those of the twist that is looked at.

import { useRef } from "preact/hooks";
import type { JointPreview, RobotInfo } from "../generated/wire";
import { figure } from "../text/numbers";
import { sentence } from "../text/reasons";
import { texts } from "../text/text";
import { Dial, endOfAxle, ringRange, tipOf } from "./dial";
import { pushOf, quantity, type Shown, Table, useShown, Values } from "./table";

export function WheelsDo({ preview }: { preview: JointPreview | null }) {
  const now = useShown();
  if (now === null) return null;
  const shown = { ...now, preview };
  const { robot } = shown;
  const words = texts().panel.wheels;
  const isGimbals = robot.panel === "gimbals";
  return (
    <section class={preview ? "sec looks" : "sec"}>
      <h2>
        {words.title}
        <small>{preview ? words.looked : words.setPoints}</small>
      </h2>
      {isGimbals && <Gimbals {...shown} />}
      {robot.wheels.length > 0 && <Wheels {...shown} />}
      {!isGimbals && robot.wheels.length === 0 && <Values {...shown} />}
      <InUse {...shown} />
    </section>
  );
}

function Gimbals({ robot, state, preview }: Shown) {
  const range = useRef(0);
  const words = texts().panel.wheels;
  const now = state?.modules;
  const poses = preview?.modules ?? now?.map(({ setpoint }) => setpoint) ?? [];
  const tilts = [...(now ?? []), ...poses].map(({ tilt }) => tilt);
  const ring = (range.current = ringRange(tilts, range.current));
  const most = mostPush(robot, poses);
  const names = robot.modules.map((_, i) => words.module(i + 1));
  const dials = names.map((name, i) => {
    const [pose, measured] = [poses[i], now?.[i]];
    return (
      <Dial
        label={words.dial(name, figure(pose?.tilt, 1), figure(pose?.direction))}
        dot={measured && endOfAxle(measured, ring)}
        goal={pose && endOfAxle(pose, ring)}
        push={pose && tipOf(pose.push, most)}
      />
    );
  });
  const each = names.map((_, i) => poses[i]);
  const rows = [
    ["", ...dials],
    quantity(words.tilt, "°", 1, ...each.map((pose) => pose?.tilt)),
    quantity("α", "°", 1, ...each.map((pose) => pose?.alpha)),
    quantity("β", "°", 1, ...each.map((pose) => pose?.beta)),
    quantity(words.push, "m/s", 2, ...each.map((pose) => pushOf(pose?.push))),
    quantity(words.wheel, words.rpm, 0, ...each.map((pose) => pose?.rpm)),
  ];
  return (
    <>
      <Table label={words.title} heads={[words.ring(figure(ring)), ...names]} rows={rows} />
      <p class="keys note">
        <span>{words.axle}</span>
        <span class="k-set">{preview ? words.looked : words.setPoint}</span>
        <span class="k-push">{words.push}</span>
      </p>
    </>
  );
}

function Wheels({ robot, state, preview }: Shown) {
  const words = texts().panel.wheels;
  const now = state?.wheels;
  const poses =
    preview?.wheels ?? now?.map((one) => ({ rpm: one.rpm_setpoint, push: one.push_setpoint })) ?? [];
  const most = mostPush(robot, poses);
  const names = robot.wheels.map((_, i) => words.wheelNumber(i + 1));
  const pushes = names.map((_, i) => poses[i] && pushOf(poses[i].push, poses[i].rpm));
  const dials = names.map((name, i) => (
    <Dial
      label={words.wheelDial(name, figure(pushes[i], 2))}
      dot={now?.[i] && tipOf(now[i].push, most)}
      push={poses[i] && tipOf(poses[i].push, most)}
    />
  ));
  const rows = [
    ["", ...dials],
    quantity(words.rpm, "", 0, ...names.map((_, i) => poses[i]?.rpm)),
    quantity(words.push, "m/s", 2, ...pushes),
  ];
  return (
    <>
      <Table label={words.title} heads={["", ...names]} rows={rows} />
      <p class="keys note">
        <span>{words.measured}</span>
        <span class="k-push">{words.push}</span>
      </p>
    </>
  );
}

/** Fastest push of a dial, in m/s: all of them have one scale. */
function mostPush(robot: RobotInfo, poses: readonly { push: [number, number] }[]): number {
  return Math.max(robot.limits.speed_mps, ...poses.map(({ push }) => Math.hypot(...push)));
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
