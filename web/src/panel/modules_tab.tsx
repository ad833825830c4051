// Modules tab: measured values and set-points of each module or wheel, and whether they agree.

import type { RobotInfo, RobotState } from "../generated/wire";
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

export function ModulesTab() {
  const { link } = useSession();
  const { drive, modules: words } = texts().panel;
  const robot = link.robot.value;
  if (robot === null || link.beat.value < 0) return <p class="note">{drive.waiting}</p>;
  const state = isCurrent(freshness(link)) ? link.state.peek() : null; // Beats suffice for figures.
  const shown = { robot, state };
  const isGimbals = robot.panel === "gimbals";
  return (
    <>
      {(isGimbals || robot.panel === "wheels") && <Agreement {...shown} />}
      {robot.wheels.length > 0 && <Wheels {...shown} />}
      {isGimbals ? (
        <div class="modules">
          {robot.modules.map((name, i) => (
            <Gimbal key={name} {...shown} name={name} index={i} />
          ))}
        </div>
      ) : (
        robot.wheels.length === 0 && <Values {...shown} />
      )}
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

function Gimbal({ state, name, index }: Shown & { name: string; index: number }) {
  const { modules: words, wheels } = texts().panel;
  const module = state?.modules[index];
  const goal = module?.setpoint;
  const { suspect, contributions } = state?.status.consistency ?? {};
  const share = contributions?.[name];
  const phase = module && (module.spinning ? words.spinning : words.atRest);
  const title = wheels.module(index + 1);
  const row = (
    label: string,
    unit: string,
    decimals: number,
    ...pair: (number | null | undefined)[]
  ) => [label, ...pair.map((one) => value(one, decimals, unit))];
  const rows = [
    row(wheels.tilt, "°", 1, module?.tilt, goal?.tilt),
    row(words.direction, "°", 0, module?.direction, goal?.direction),
    row("α", "°", 1, module?.alpha, module?.alpha_setpoint),
    row("β", "°", 1, module?.beta, module?.beta_setpoint),
    row(wheels.push, "m/s", 2, pushOf(module?.push), pushOf(goal?.push)),
    row(wheels.wheel, wheels.rpm, 0, module?.rpm, goal?.rpm),
    [...row(words.radius, "mm", 1, module?.radius_mm), ""],
    [...row(words.share, "%", 0, share === undefined ? null : 100 * share), ""],
  ];
  return (
    <section class={suspect === name ? "sec suspect" : "sec"}>
      <h2>
        {title}
        <small>{suspect === name ? words.suspect : phase}</small>
      </h2>
      <Table label={title} heads={["", wheels.measured, wheels.setPoint]} rows={rows} pairs />
    </section>
  );
}

function Wheels({ robot, state }: Shown) {
  const { modules: words, wheels } = texts().panel;
  const rows = robot.wheels.map((name, i) => {
    const wheel = state?.wheels[i];
    const isSuspect = state?.status.consistency.suspect === name;
    return [
      <span class={isSuspect ? "suspect" : undefined}>{wheels.wheelNumber(i + 1)}</span>,
      value(wheel?.rpm, 0, wheels.rpm),
      value(wheel?.rpm_setpoint, 0, wheels.rpm),
      value(wheel?.residual_mps, 3, "m/s"),
    ];
  });
  const heads = ["", wheels.measured, wheels.setPoint, words.unexplained];
  return <Table label={wheels.title} heads={heads} rows={rows} pairs />;
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
