// Speed of continuously spinning wheels: what it brings and what it costs.

import { useEffect, useRef, useState } from "preact/hooks";
import type { RobotInfo, WheelSpeedLimits, WheelSpeedStatus } from "../generated/wire";
import { useSession } from "../session";
import { whyNot } from "../store/permission";
import { refusalText } from "../text/reasons";
import { degrees, figure, texts } from "../text/text";
import { Fold } from "../ui/fold";
import { useShown } from "./table";

const KEPT_MS = 1500; // A chosen value is shown for this long before the robot confirms it.
const CHANGING_RPM = 15;

export function WheelSpeed({ robot, limits }: { robot: RobotInfo; limits: WheelSpeedLimits }) {
  const { link, requests } = useSession();
  const { speed: words, wheels } = texts().panel;
  const [typed, setTyped] = useState<{ label: string; text: string; rpm: number } | null>(null);
  const [chosen, setChosen] = useState<{ rpm: number; untilMs: number } | null>(null);
  const next = useRef<number | null>(null);
  const isBusy = requests.pending.value === "wheel_speed";
  useEffect(() => {
    if (isBusy || next.current === null) return; // One at a time; a later one replaces the waiting.
    requests.send({ t: "wheel_speed", cruise_speed_rpm: next.current });
    next.current = null;
  }, [isBusy, chosen]);
  const status = link.state.value?.status.wheel_speed;
  const current = useShown()?.state ? status : null;
  const refusal = whyNot(link, "speed");
  const isKept = chosen !== null && performance.now() <= chosen.untilMs;
  const edited = typed ? typed.rpm : isKept ? chosen.rpm : NaN;
  const asked = refusal === null && Number.isFinite(edited) ? edited : status?.requested_rpm;
  const rpm = asked ?? limits.default_rpm;
  const perRpm = rimOf(limits, 1) * Math.sin(((robot.max_tilt_deg ?? 0) * Math.PI) / 180);

  /** Field whose unit is `unit` for each rpm. */
  const field = (label: string, type: "number" | "range", step: number, unit = 1) => {
    const decimals = step < 1 ? 1 : 0;
    const shown = (value: number) => (unit * value).toFixed(decimals);
    const read = (text: string) => {
      // The slowest wheel speed that is enough allows the finest steps.
      const enough = text === "" ? NaN : Math.ceil(Number(text) / unit - 1e-9);
      return Math.max(limits.least_rpm, Math.min(limits.most_rpm, enough));
    };
    const choose = (text: string) => {
      setTyped(null);
      if (Number.isNaN(read(text))) return;
      next.current = read(text);
      setChosen({ rpm: next.current, untilMs: performance.now() + KEPT_MS });
    };
    return (
      <input
        type={type}
        aria-label={label}
        disabled={refusal !== null}
        step={step}
        min={shown(limits.least_rpm)}
        max={shown(limits.most_rpm)}
        value={typed?.label === label ? typed.text : shown(rpm)}
        onInput={({ currentTarget: { value: text } }) => setTyped({ label, text, rpm: read(text) })}
        onChange={({ currentTarget }) => choose(currentTarget.value)}
        onBlur={() => setTyped(null)}
      />
    );
  };
  return (
    <Fold title={words.title} summary={`${figure(current?.requested_rpm)} ${wheels.rpm}`}>
      {field(words.title, "range", 50)}
      <div class="speeds">
        <span class="field">
          {field(words.inRpm, "number", 1)}
          <span class="u">{wheels.rpm}</span>
        </span>
        <span class="field">
          {field(words.upTo, "number", 0.1, perRpm)}
          <span class="u">m/s</span>
        </span>
      </div>
      <p class="note" role="status">
        {refusal ? refusalText(refusal) : current && changeOf(current)}
      </p>
      <p class="note">{effectOf(robot, limits, rpm, perRpm * rpm)}</p>
    </Fold>
  );
}

function changeOf({ spin_rpm: now, requested_rpm: asked }: WheelSpeedStatus) {
  const { speed: words } = texts().panel;
  return now <= 1 ? words.standing : Math.abs(now - asked) > CHANGING_RPM && words.now(figure(now));
}

function effectOf(robot: RobotInfo, limits: WheelSpeedLimits, rpm: number, topMps: number) {
  const { speed: words } = texts().panel;
  const rim = rimOf(limits, rpm);
  const step = (1000 * rim * limits.servo_step_deg * Math.PI) / 180;
  const { max_speed_mps: limit } = robot;
  return [
    words.reach(figure(rpm), figure(topMps, 1), figure(robot.max_tilt_deg)),
    words.step(figure(step)),
    rim >= 1 ? words.oneNeeds(figure(degrees(Math.asin(1 / rim)), 1)) : words.outOfReach,
    (limit < topMps ? words.limitStays : words.below)(figure(limit, 1)),
  ].join(" ");
}

/** Rim speed of a wheel in m/s. */
function rimOf({ wheel_radius_m }: WheelSpeedLimits, rpm: number): number {
  return (wheel_radius_m * rpm * Math.PI) / 30;
}
