// Modules tab: measured values and set-points of each module or wheel, and whether they agree.

import type { GimbalState, RobotInfo, RobotState, WheelState } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { Sphere } from "./sphere";
import { pushOf, Table, value, Values } from "./table";

const SHUT_OFF = new Set(["disarmed", "stopped", "fault"]);
const OFF_DEG = 0.5; // A gimbal that is farther from its set-point does not follow.

interface Shown {
  robot: RobotInfo;
  /** Null while the figures are not those of now. */
  state: RobotState | null;
}

/** Name, unit, decimals, measured value and, if there is one, set-point. */
type Row = readonly [string, string, number, (number | null)?, (number | null)?];

export function ModulesTab() {
  const { link } = useSession();
  const { drive, modules: words, wheels } = texts().panel;
  const robot = link.robot.value;
  if (robot === null || link.beat.value < 0) return <p class="note">{drive.waiting}</p>;
  const state = isCurrent(freshness(link)) ? link.state.peek() : null; // Beats suffice for figures.
  const shown = { robot, state };
  const isGimbals = robot.panel === "gimbals";
  const names = isGimbals ? robot.modules : robot.wheels;
  return (
    <>
      {(isGimbals || robot.panel === "wheels") && <Agreement {...shown} />}
      {names.length === 0 && <Values {...shown} />}
      <div class="modules">
        {names.map((name, i) => {
          const title = isGimbals ? wheels.module(i + 1) : wheels.wheelNumber(i + 1);
          const isSuspect = state?.status.consistency.suspect === name;
          const module = state?.modules[i];
          const phase = module && (module.spinning ? words.spinning : words.atRest);
          const rows = isGimbals ? ofGimbal(name, module, state) : ofWheel(state?.wheels[i]);
          return (
            <section key={name} class={isSuspect ? "sec suspect" : "sec"}>
              <h2>
                {title}
                <small>{isSuspect ? words.suspect : phase}</small>
              </h2>
              <Compared label={title} rows={rows} />
            </section>
          );
        })}
      </div>
      {isGimbals && <p class="note">{words.directions}</p>}
      {robot.panel === "sphere" && <Sphere sphere={state?.sphere ?? null} />}
      <OtherEstimate {...shown} />
      {robot.not_promised.length > 0 && (
        <section class="sec">
          <h2>{words.notPromised}</h2>
          <ul class="points">
            {robot.not_promised.map((sentence) => (
              <li key={sentence}>{sentence}</li>
            ))}
          </ul>
        </section>
      )}
    </>
  );
}

function ofGimbal(name: string, module: GimbalState | undefined, state: RobotState | null): Row[] {
  const { modules: words, wheels } = texts().panel;
  const goal = module?.setpoint;
  const share = state?.status.consistency.contributions[name];
  return [
    [wheels.tilt, "°", 1, module?.tilt, goal?.tilt],
    [words.direction, "°", 0, module?.direction, goal?.direction],
    ["α", "°", 1, module?.alpha, module?.alpha_setpoint],
    ["β", "°", 1, module?.beta, module?.beta_setpoint],
    [wheels.push, "m/s", 2, pushOf(module?.push), pushOf(goal?.push)],
    [wheels.wheel, wheels.rpm, 0, module?.rpm, goal?.rpm],
    [words.radius, "mm", 1, module?.radius_mm],
    [words.share, "%", 0, share === undefined ? null : 100 * share],
  ];
}

function ofWheel(wheel: WheelState | undefined): Row[] {
  const { modules: words, wheels } = texts().panel;
  const [goalRpm, goal] = [wheel?.rpm_setpoint, wheel?.push_setpoint];
  return [
    [wheels.wheel, wheels.rpm, 0, wheel?.rpm, goalRpm],
    [wheels.push, "m/s", 2, pushOf(wheel?.push, wheel?.rpm), pushOf(goal, goalRpm)],
    [words.unexplained, "m/s", 3, wheel?.residual_mps],
  ];
}

function Compared({ label, rows }: { label: string; rows: readonly Row[] }) {
  const { wheels: words } = texts().panel;
  const cells = rows.map((row) => {
    const [name, unit, decimals, measured, goal] = row;
    const cell = value(measured, decimals, unit);
    return [name, cell, row.length > 4 ? value(goal, decimals, unit) : ""];
  });
  return <Table label={label} heads={["", words.measured, words.setPoint]} rows={cells} pairs />;
}

/** Whether the actuators agree on one motion, and which of them does not. */
function Agreement({ robot, state }: Shown) {
  const isSuspicious = (state?.status.consistency.suspect ?? null) !== null;
  return (
    <section class={isSuspicious ? "sec suspect" : "sec"}>
      <h2>
        {texts().panel.modules.agreement}
        <small>
          {texts().panel.modules.unexplained}{" "}
          {value(state?.status.consistency.residual_mps, 3, "m/s")}
        </small>
      </h2>
      <p>{state && verdictOf(robot, state)}</p>
    </section>
  );
}

function verdictOf(robot: RobotInfo, state: RobotState): string {
  const { modules: words, wheels } = texts().panel;
  const { suspect } = state.status.consistency;
  const isGimbals = robot.panel === "gimbals";
  if (suspect === null) {
    if (isGimbals) return words.modulesAgree;
    return robot.wheels.length < 4 ? words.threeWheels : words.wheelsAgree;
  }
  const at = (isGimbals ? robot.modules : robot.wheels).indexOf(suspect);
  const name = isGimbals ? wheels.module(at + 1) : wheels.wheelNumber(at + 1);
  const module = state.modules[at];
  const alphaDeg = module ? Math.abs(module.alpha - module.alpha_setpoint) : 0;
  const betaDeg = module ? Math.abs(module.beta - module.beta_setpoint) : 0;
  const offDeg = Math.max(alphaDeg, betaDeg);
  if (offDeg < OFF_DEG) return words.contradicts(name);
  const end = SHUT_OFF.has(state.status.mode) ? words.shutOff : words.pushes;
  const gimbal = betaDeg > alphaDeg ? "β" : "α";
  return `${words.doesNotFollow(name, gimbal, figure(offDeg, 1))} ${end}`;
}

function OtherEstimate({ robot, state }: Shown) {
  const { modules: words } = texts().panel;
  const source = robot.alternative_estimate;
  const difference = state?.estimate_difference;
  if (source === null || !difference) return null;
  const metres = state?.pose ? figure(difference.metres, 3) : null; // A sphere has no place.
  return (
    <section class="sec">
      <h2>{words.otherEstimate}</h2>
      <p>{words.differs(source, metres, figure(difference.degrees, 1))}</p>
    </section>
  );
}
