// Modules tab: measured values and set-points of each module or wheel, and whether they agree.

import type { RobotState } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { Figure } from "../ui/figure";
import { Sphere } from "./sphere";
import { pushOf, quantity, type Shown, Table, useShown, Values } from "./table";

const SHUT_OFF = new Set(["disarmed", "stopped", "fault"]);
const OFF_DEG = 0.5; // A gimbal that is farther from its set-point does not follow.

export function ModulesTab() {
  const { drive, modules: words } = texts().panel;
  const shown = useShown();
  if (shown === null) return <p class="note">{drive.waiting}</p>;
  const { robot, state } = shown;
  const isGimbals = robot.panel === "gimbals";
  return (
    <>
      {(isGimbals || robot.panel === "wheels") && <Agreement {...shown} />}
      {robot.wheels.length > 0 && <Wheels {...shown} />}
      {isGimbals && (
        <div class="modules">
          {robot.modules.map((name, i) => (
            <Gimbal key={name} state={state} name={name} index={i} />
          ))}
        </div>
      )}
      {isGimbals && <p class="note">{words.directions}</p>}
      {!isGimbals && robot.wheels.length === 0 && <Values {...shown} />}
      {robot.panel === "sphere" && <Sphere sphere={state?.sphere ?? null} />}
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

interface GimbalProps {
  state: RobotState | null;
  name: string;
  index: number;
}

function Gimbal({ state, name, index }: GimbalProps) {
  const { modules: words, wheels } = texts().panel;
  const module = state?.modules[index];
  const goal = module?.setpoint;
  const { suspect, contributions } = state?.status.consistency ?? {};
  const isSuspect = suspect === name;
  const percent = 100 * (contributions?.[name] ?? NaN);
  const phase = module && (module.spinning ? words.spinning : words.atRest);
  const title = wheels.module(index + 1);
  const rows = [
    quantity(wheels.tilt, "°", 1, module?.tilt, goal?.tilt),
    quantity(words.direction, "°", 0, module?.direction, goal?.direction),
    quantity("α", "°", 1, module?.alpha, goal?.alpha),
    quantity("β", "°", 1, module?.beta, goal?.beta),
    quantity(wheels.push, "m/s", 2, pushOf(module?.push), pushOf(goal?.push)),
    quantity(wheels.wheel, wheels.rpm, 0, module?.rpm, goal?.rpm),
    [...quantity(words.radius, "mm", 1, module?.radius_mm), ""],
    [...quantity(words.share, "%", 0, percent), ""],
  ];
  return (
    <section class={isSuspect ? "sec suspect" : "sec"}>
      <h2>
        {title}
        <small>{isSuspect ? words.suspect : phase}</small>
      </h2>
      <Table label={title} heads={["", wheels.measured, wheels.setPoint]} rows={rows} pairs />
    </section>
  );
}

function Wheels({ robot, state }: Shown) {
  const { modules: words, wheels } = texts().panel;
  const suspect = state?.status.consistency.suspect;
  const rows = robot.wheels.map((name, i) => {
    const wheel = state?.wheels[i];
    const title = <span class={suspect === name ? "suspect" : ""}>{wheels.wheelNumber(i + 1)}</span>;
    return [
      ...quantity(title, wheels.rpm, 0, wheel?.rpm, wheel?.rpm_setpoint),
      <Figure value={wheel?.residual_mps} decimals={3} unit="m/s" />,
    ];
  });
  const heads = ["", wheels.measured, wheels.setPoint, words.unexplained];
  return <Table label={wheels.title} heads={heads} rows={rows} pairs />;
}

/** Whether the actuators agree on one motion, and which of them does not. */
function Agreement(shown: Shown) {
  const { agreement, unexplained } = texts().panel.modules;
  const { residual_mps, suspect } = shown.state?.status.consistency ?? {};
  return (
    <section class={suspect ? "sec suspect" : "sec"}>
      <h2>
        {agreement}
        <small>
          {unexplained} <Figure value={residual_mps} decimals={3} unit="m/s" />
        </small>
      </h2>
      <p>{verdictOf(shown)}</p>
    </section>
  );
}

function verdictOf({ robot, state }: Shown): string | null {
  const { modules: words, wheels } = texts().panel;
  if (state === null) return null;
  const { suspect } = state.status.consistency;
  const isGimbals = robot.panel === "gimbals";
  if (suspect === null) {
    if (isGimbals) return words.modulesAgree;
    return robot.wheels.length < 4 ? words.threeWheels : words.wheelsAgree;
  }
  const at = (isGimbals ? robot.modules : robot.wheels).indexOf(suspect);
  const name = isGimbals ? wheels.module(at + 1) : wheels.wheelNumber(at + 1);
  const { alpha = 0, beta = 0, setpoint = { alpha, beta } } = state.modules[at] ?? {};
  const [alphaDeg, betaDeg] = [Math.abs(alpha - setpoint.alpha), Math.abs(beta - setpoint.beta)];
  const offDeg = Math.max(alphaDeg, betaDeg);
  if (offDeg < OFF_DEG) return words.contradicts(name);
  const end = SHUT_OFF.has(state.status.mode) ? words.shutOff : words.pushes;
  const gimbal = betaDeg > alphaDeg ? "β" : "α";
  return `${words.doesNotFollow(name, gimbal, figure(offDeg, 1))} ${end}`;
}
