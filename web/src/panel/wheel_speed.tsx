// Speed of continuously spinning wheels: what it brings and what it costs.

import { useEffect, useRef, useState } from "preact/hooks";
import type { RobotInfo, WheelSpeedLimits, WheelSpeedStatus } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { whyNotWheelSpeed } from "../store/permission";
import { degrees, figure } from "../text/numbers";
import { refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Fold } from "../ui/fold";

const KEPT_MS = 1500; // A chosen value is shown for this long before the robot confirms it.
const CHANGING_RPM = 15;

export function WheelSpeed({ robot, limits }: { robot: RobotInfo; limits: WheelSpeedLimits }) {
  const { link, requests } = useSession();
  const [draft, setDraft] = useState<number | null>(null); // Being edited or recently chosen.
  const untilMs = useRef(0);
  const next = useRef<number | null>(null);
  const busy = requests.isPending("wheel_speed");
  const ask = (rpm: number) => {
    next.current = busy ? rpm : null; // One request at a time; a later one replaces the waiting.
    if (!busy) requests.send({ t: "wheel_speed", cruise_speed_rpm: rpm });
  };
  useEffect(() => {
    if (!busy && next.current !== null) ask(next.current);
  }, [busy]);
  const { speed: words, wheels } = texts().panel;
  const status = link.beat.value >= 0 ? (link.state.value?.status.wheel_speed ?? null) : null;
  const refusal = whyNotWheelSpeed(link);
  const holds = draft !== null && refusal === null && performance.now() <= untilMs.current;
  const rpm = (holds ? draft : status?.requested_rpm) ?? limits.default_rpm;
  const current = isCurrent(freshness(link)) ? status : null;
  const perRpm = rimOf(limits, 1) * Math.sin(((robot.max_tilt_deg ?? 0) * Math.PI) / 180);
  const field = {
    limits,
    rpm,
    disabled: refusal !== null,
    onEdit: (edited: number | null, isDone: boolean) => {
      untilMs.current = isDone ? performance.now() + KEPT_MS : Infinity;
      setDraft(edited);
      if (isDone && edited !== null) ask(edited);
    },
  };
  return (
    <Fold title={words.title} summary={`${figure(current?.requested_rpm)} ${wheels.rpm}`}>
      <Field {...field} label={words.title} type="range" step={50} />
      <div class="speeds">
        <Field {...field} label={words.inRpm} unit={wheels.rpm} step={1} />
        <Field {...field} label={words.upTo} unit="m/s" step={0.1} perRpm={perRpm} />
      </div>
      <p class="note" role="status">
        {refusal ? refusalText(refusal) : current && changeOf(current)}
      </p>
      <p class="note">{effectOf(robot, limits, rpm, perRpm * rpm)}</p>
    </Fold>
  );
}

function changeOf({ spin_rpm, requested_rpm }: WheelSpeedStatus): string | null {
  const { speed: words } = texts().panel;
  if (spin_rpm <= 1) return words.standing;
  return Math.abs(spin_rpm - requested_rpm) > CHANGING_RPM ? words.now(figure(spin_rpm)) : null;
}

function effectOf(robot: RobotInfo, limits: WheelSpeedLimits, rpm: number, topMps: number) {
  const { speed: words } = texts().panel;
  const rim = rimOf(limits, rpm);
  const step = (1000 * rim * limits.servo_step_deg * Math.PI) / 180;
  const { speed_mps: limit } = robot.limits;
  return [
    words.reach(figure(rpm), figure(topMps, 1), figure(robot.max_tilt_deg)),
    words.step(figure(step)),
    rim >= 1 ? words.oneNeeds(figure(degrees(Math.asin(1 / rim)), 1)) : words.outOfReach,
    (limit < topMps ? words.limitStays : words.below)(figure(limit, 1)),
  ].join(" ");
}

interface FieldProps {
  limits: WheelSpeedLimits;
  rpm: number;
  label: string;
  type?: "range" | "number";
  unit?: string;
  step: number;
  /** What the field shows for each rpm. */
  perRpm?: number;
  disabled: boolean;
  /** Called with the wheel speed, or null for what is no number. */
  onEdit: (rpm: number | null, isDone: boolean) => void;
}

function Field(props: FieldProps) {
  const { limits, rpm, label, type = "number", unit, step, perRpm = 1, disabled, onEdit } = props;
  const [typed, setTyped] = useState<string | null>(null);
  const decimals = step < 1 ? 1 : 0;
  const most = 10 ** decimals;
  const edit = (text: string | null, isDone: boolean) => {
    setTyped(isDone ? null : text);
    // The slowest wheel speed that is enough allows the finest steps.
    const asked = text ? Math.ceil(Number(text) / perRpm - 1e-9) : NaN;
    const within = Math.max(limits.least_rpm, Math.min(limits.most_rpm, asked));
    onEdit(Number.isFinite(asked) ? within : null, isDone);
  };
  const input = (
    <input
      type={type}
      aria-label={label}
      disabled={disabled}
      step={step}
      min={Math.floor(most * perRpm * limits.least_rpm) / most}
      max={Math.ceil(most * perRpm * limits.most_rpm) / most}
      value={typed ?? (perRpm * rpm).toFixed(decimals)}
      onInput={({ currentTarget }) => edit(currentTarget.value, false)}
      onChange={({ currentTarget }) => edit(currentTarget.value, true)}
      onBlur={() => typed !== null && edit(null, true)}
    />
  );
  return type === "range" ? (
    input
  ) : (
    <span class="field">
      {input}
      <span class="u">{unit}</span>
    </span>
  );
}

/** Rim speed of a wheel in m/s. */
function rimOf({ wheel_radius_m }: WheelSpeedLimits, rpm: number): number {
  return (wheel_radius_m * rpm * Math.PI) / 30;
}
