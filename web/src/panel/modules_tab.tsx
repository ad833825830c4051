// Modules tab: measured values and set-points of each module or wheel, and whether they agree.

import type { GimbalState, RobotInfo, RobotState } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { Sphere } from "./sphere";
import { Values } from "./wheels";

const SHUT_OFF = new Set(["disarmed", "stopped", "fault"]);
const OFF_DEG = 0.5; // A gimbal that is farther from its set-point does not follow.

interface Shown {
  robot: RobotInfo;
  /** Null while the figures are not those of now. */
  state: RobotState | null;
}

export function ModulesTab() {
  const { link } = useSession();
  const robot = link.robot.value;
  if (robot === null || link.beat.value < 0)
    return <p class="note">{texts().panel.drive.waiting}</p>;
  const state = isCurrent(freshness(link)) ? link.state.peek() : null; // Beats suffice for figures.
  const shown = { robot, state };
  if (robot.panel === "gimbals")
    return (
      <>
        <Agreement {...shown} />
        <div class="modules">
          {robot.modules.map((name, i) => (
            <Gimbal key={name} {...shown} index={i} />
          ))}
        </div>
        <p class="note">{texts().panel.modules.directions}</p>
      </>
    );
  return (
    <>
      {robot.wheels.length > 0 ? <Wheels {...shown} /> : <Values {...shown} preview={null} />}
      {robot.panel === "sphere" && <Sphere sphere={state?.sphere ?? null} />}
      {robot.panel === "wheels" && <Agreement {...shown} />}
      <OtherEstimate {...shown} />
      <NotPromised robot={robot} />
    </>
  );
}

function Gimbal({ robot, state, index }: Shown & { index: number }) {
  const { modules: words, wheels } = texts().panel;
  const module = state?.modules[index];
  const goal = module?.setpoint;
  const isSuspect = state?.status.consistency.suspect === robot.modules[index];
  const phase = isSuspect ? words.suspect : module?.spinning ? words.spinning : words.atRest;
  const push = (velocity?: [number, number]) => velocity && Math.hypot(...velocity);
  const rows: readonly Row[] = [
    [wheels.tilt, "°", 1, module?.tilt, goal?.tilt],
    [words.direction, "°", 0, module?.direction, goal?.direction],
    ["α", "°", 1, module?.alpha, module?.alpha_setpoint],
    ["β", "°", 1, module?.beta, module?.beta_setpoint],
    [wheels.push, "m/s", 2, push(module?.push), push(goal?.push)],
    [wheels.wheel, wheels.rpm, 0, module?.rpm, goal?.rpm],
    [words.radius, "mm", 1, module?.radius_mm],
    [words.unexplained, "%", 0, shareOf(robot.modules[index], state)],
  ];
  return (
    <section class={isSuspect ? "sec suspect" : "sec"}>
      <h2>
        {wheels.module(index + 1)}
        <small>{module && phase}</small>
      </h2>
      <Compared label={wheels.module(index + 1)} rows={rows} />
    </section>
  );
}

function Wheels({ robot, state }: Shown) {
  const { modules: words, wheels } = texts().panel;
  const suspect = state?.status.consistency.suspect;
  return (
    <div class="modules">
      {robot.wheels.map((name, i) => {
        const wheel = state?.wheels[i];
        const title = wheels.wheelNumber(i + 1);
        const rows: readonly Row[] = [
          [wheels.rpm, "", 0, wheel?.rpm, wheel?.rpm_setpoint],
          [
            wheels.push,
            "m/s",
            2,
            signedPush(wheel?.push, wheel?.rpm),
            signedPush(wheel?.push_setpoint, wheel?.rpm_setpoint),
          ],
          [words.contradiction, "m/s", 3, wheel?.residual_mps],
        ];
        return (
          <section key={name} class={name === suspect ? "sec suspect" : "sec"}>
            <h2>
              {title}
              <small>{name === suspect && words.suspect}</small>
            </h2>
            <Speed
              label={title}
              rpm={wheel?.rpm}
              setRpm={wheel?.rpm_setpoint}
              most={robot.max_rpm ?? 0}
            />
            <Compared label={title} rows={rows} />
          </section>
        );
      })}
    </div>
  );
}

const signedPush = (push?: [number, number], rpm = 0) =>
  push && Math.sign(rpm) * Math.hypot(...push);

/** Share of the contradiction that a module explains, in percent. */
function shareOf(name: string | undefined, state: RobotState | null): number | null {
  const share = state?.status.consistency.contributions[name ?? ""];
  return share === undefined ? null : 100 * share;
}

interface SpeedProps {
  label: string;
  rpm: number | undefined;
  setRpm: number | undefined;
  most: number;
}

/** Bar from the middle, forward to the right, with a tick at the set-point. */
function Speed({ label, rpm, setRpm, most }: SpeedProps) {
  const at = (value = 0) => (most > 0 ? 50 + 50 * Math.max(-1, Math.min(1, value / most)) : 50);
  const [from, to] = [Math.min(50, at(rpm)), Math.max(50, at(rpm))];
  return (
    <div
      class="bar2"
      role="meter"
      aria-label={texts().panel.modules.speedOf(label)}
      aria-valuemin={-most}
      aria-valuemax={most}
      aria-valuenow={Math.round(rpm ?? 0)}
      aria-valuetext={`${figure(rpm)} ${texts().panel.wheels.rpm}`}
    >
      <i class="fill" style={{ left: `${from}%`, right: `${100 - to}%` }} />
      {setRpm !== undefined && <i class="tick" style={{ left: `${at(setRpm)}%` }} />}
    </div>
  );
}

/** Name, unit, decimals, measured value and, if there is one, set-point. */
type Row = readonly [string, string, number, (number | null)?, (number | null)?];

function Compared({ label, rows }: { label: string; rows: readonly Row[] }) {
  const { modules: words, wheels } = texts().panel;
  const cell = (value: number | null | undefined, decimals: number, unit: string) => (
    <>
      {figure(value, decimals)}
      {unit === "°" ? unit : <span class="u">{unit}</span>}
    </>
  );
  return (
    <table class="mods pairs" aria-label={label}>
      <thead>
        <tr>
          <th scope="col">
            <span class="sr">{wheels.quantity}</span>
          </th>
          <th scope="col">{words.measured}</th>
          <th scope="col">{words.setPoint}</th>
        </tr>
      </thead>
      <tbody>
        {rows.map(({ 0: name, 1: unit, 2: decimals, 3: value, 4: goal, length }) => (
          <tr key={name}>
            <th scope="row">{name}</th>
            <td>{cell(value, decimals, unit)}</td>
            <td>{length > 4 && cell(goal, decimals, unit)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** Whether the actuators agree on one motion, and which of them does not. */
function Agreement({ robot, state }: Shown) {
  const { modules: words } = texts().panel;
  if (state === null) return null;
  const { residual_mps, level, suspect } = state.status.consistency;
  const verdict = verdictOf(robot, state, suspect);
  return (
    <section class={suspect === null ? "sec" : "sec suspect"}>
      <h2>
        {words.agreement}
        <small>
          {figure(residual_mps, 3)}
          <span class="u">m/s</span>
        </small>
      </h2>
      <div
        class="bar2"
        role="meter"
        aria-label={words.agreement}
        aria-valuemin={0}
        aria-valuemax={1}
        aria-valuenow={Math.min(1, level)}
        aria-valuetext={verdict}
      >
        <i class="fill" style={{ left: 0, right: `${100 * (1 - Math.min(1, level))}%` }} />
      </div>
      <p>{verdict}</p>
    </section>
  );
}

function verdictOf(robot: RobotInfo, state: RobotState, suspect: string | null): string {
  const { modules: words, wheels } = texts().panel;
  const isGimbals = robot.panel === "gimbals";
  if (suspect === null) {
    if (isGimbals) return words.modulesAgree;
    return robot.wheels.length < 4 ? words.threeWheels : words.wheelsAgree;
  }
  if (!isGimbals) return words.contradicts(wheels.wheelNumber(robot.wheels.indexOf(suspect) + 1));
  const at = robot.modules.indexOf(suspect);
  const name = wheels.module(at + 1);
  const off = gimbalError(state.modules[at]);
  if (off === null) return words.contradicts(name);
  const [gimbal, byDeg] = off;
  const end = SHUT_OFF.has(state.status.mode) ? words.shutOff : words.pushes;
  return `${words.doesNotFollow(name, gimbal, figure(byDeg, 1))} ${end}`;
}

/** Gimbal that is farther from its set-point, and by how many degrees; null if both follow. */
function gimbalError(module: GimbalState | undefined): ["α" | "β", number] | null {
  if (module === undefined) return null;
  const alpha = Math.abs(module.alpha - module.alpha_setpoint);
  const beta = Math.abs(module.beta - module.beta_setpoint);
  if (Math.max(alpha, beta) < OFF_DEG) return null;
  return beta > alpha ? ["β", beta] : ["α", alpha];
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

function NotPromised({ robot }: { robot: RobotInfo }) {
  if (robot.not_promised.length === 0) return null;
  return (
    <section class="sec">
      <h2>{texts().panel.modules.notPromised}</h2>
      <ul class="points">
        {robot.not_promised.map((sentence) => (
          <li key={sentence}>{sentence}</li>
        ))}
      </ul>
    </section>
  );
}
