// Speed of continuously spinning wheels: what it brings and what it costs.

import { effect } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import type { WheelSpeedLimits } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { whyNotWheelSpeed } from "../store/permission";
import type { Requests } from "../store/requests";
import { degrees, figure } from "../text/numbers";
import { refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Fold } from "../ui/fold";

const STEP_RPM = 50;
const KEPT_MS = 1500; // A chosen value is shown for this long before the robot confirms it.
const CHANGING_RPM = 15;

/** Asks for one speed at a time; a later one replaces the one that waits. */
class Asking {
  readonly #requests: Requests;
  #next: number | null = null;

  constructor(requests: Requests) {
    this.#requests = requests;
  }

  follow(): () => void {
    return effect(() => {
      if (!this.#requests.isPending("wheel_speed") && this.#next !== null) this.ask(this.#next);
    });
  }

  ask(cruise_speed_rpm: number): void {
    const waits = this.#requests.pending.peek()?.request.t === "wheel_speed";
    this.#next = waits ? cruise_speed_rpm : null;
    if (!waits) this.#requests.send({ t: "wheel_speed", cruise_speed_rpm });
  }
}

export function WheelSpeed({ limits }: { limits: WheelSpeedLimits }) {
  const { link, requests } = useSession();
  const asking = useMemo(() => new Asking(requests), [requests]);
  useEffect(() => asking.follow(), [asking]);
  const [draft, setDraft] = useState<number | null>(null); // Being edited or recently chosen.
  const untilMs = useRef(0);
  const { speed: words } = texts().panel;
  const status = link.beat.value >= 0 ? link.state.value?.status.wheel_speed : null;
  const refusal = whyNotWheelSpeed(link);
  const holds = draft !== null && refusal === null && performance.now() <= untilMs.current;
  const rpm = (holds ? draft : status?.requested_rpm) ?? limits.default_rpm;
  const edit = (value: number | null, forMs: number) => {
    untilMs.current = performance.now() + forMs;
    setDraft(value);
  };
  const field = (perRpm: number) => {
    // The slowest wheel speed that is enough allows the finest steps.
    const rpmOf = (text: string) => {
      const typed = text === "" ? NaN : Math.ceil(Number(text) / perRpm - 1e-9);
      return Number.isFinite(typed) ? between(limits, typed) : null;
    };
    return {
      disabled: refusal !== null,
      onEdit: (text: string) => edit(rpmOf(text), Infinity),
      onTake: (text: string) => {
        const taken = rpmOf(text);
        edit(taken, KEPT_MS);
        if (taken !== null) asking.ask(taken);
      },
      onLeave: () => untilMs.current === Infinity && edit(null, 0),
    };
  };
  const tilt = link.robot.value?.max_tilt_deg ?? 0;
  const perRpm = rimOf(limits, 1) * Math.sin((tilt * Math.PI) / 180);
  const range = { min: limits.least_rpm, max: limits.most_rpm };
  const current = isCurrent(freshness(link)) ? status : null;
  return (
    <Fold title={words.title} summary={words.rpm(figure(current?.requested_rpm))}>
      <Field
        {...field(1)}
        {...range}
        type="range"
        step={STEP_RPM}
        label={words.title}
        shown={rpm}
      />
      <div class="speeds">
        <Field
          {...field(1)}
          {...range}
          step={1}
          label={words.inRpm}
          unit={texts().panel.wheels.rpm}
          shown={rpm}
        />
        <Field
          {...field(perRpm)}
          min={Math.floor(10 * perRpm * limits.least_rpm) / 10}
          max={Math.ceil(10 * perRpm * limits.most_rpm) / 10}
          step={0.1}
          label={words.upTo}
          unit="m/s"
          shown={Number((perRpm * rpm).toFixed(1))}
        />
      </div>
      <p class="note" role="status">
        {refusal
          ? refusalText(refusal)
          : current && changeOf(current.spin_rpm, current.requested_rpm)}
      </p>
      <Effect limits={limits} rpm={rpm} topMps={perRpm * rpm} tiltDeg={tilt} />
    </Fold>
  );
}

function changeOf(spinRpm: number, requestedRpm: number): string | null {
  const { speed: words } = texts().panel;
  if (spinRpm <= 1) return words.standing;
  return Math.abs(spinRpm - requestedRpm) > CHANGING_RPM ? words.now(figure(spinRpm)) : null;
}

interface EffectProps {
  limits: WheelSpeedLimits;
  rpm: number;
  topMps: number;
  tiltDeg: number;
}

function Effect({ limits, rpm, topMps, tiltDeg }: EffectProps) {
  const { speed: words } = texts().panel;
  const speedMps = useSession().link.robot.value?.limits.speed_mps ?? 0;
  const rim = rimOf(limits, rpm);
  const step = (1000 * rim * limits.servo_step_deg * Math.PI) / 180;
  const needed =
    rim >= 1 ? words.oneNeeds(figure(degrees(Math.asin(1 / rim)), 1)) : words.outOfReach;
  const limit = figure(speedMps, 1);
  return (
    <p class="note">
      {words.reach(figure(rpm), figure(topMps, 1), figure(tiltDeg))} {words.step(figure(step))}{" "}
      {needed} {speedMps < topMps ? words.limitStays(limit) : words.below(limit)}
    </p>
  );
}

interface FieldProps {
  label: string;
  type?: "range" | "number";
  unit?: string;
  shown: number;
  min: number;
  max: number;
  step: number;
  disabled: boolean;
  onEdit: (text: string) => void;
  onTake: (text: string) => void;
  onLeave: () => void;
}

function Field({
  label,
  type = "number",
  unit,
  shown,
  onEdit,
  onTake,
  onLeave,
  ...rest
}: FieldProps) {
  const [typed, setTyped] = useState<string | null>(null);
  const input = (
    <input
      {...rest}
      type={type}
      aria-label={label}
      value={typed ?? String(Math.round(1000 * shown) / 1000)}
      onInput={({ currentTarget: { value } }) => {
        setTyped(value);
        onEdit(value);
      }}
      onChange={({ currentTarget: { value } }) => {
        setTyped(null);
        onTake(value);
      }}
      onBlur={() => {
        setTyped(null);
        onLeave();
      }}
    />
  );
  if (type === "range") return input;
  return (
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

function between({ least_rpm, most_rpm }: WheelSpeedLimits, rpm: number): number {
  return Math.max(least_rpm, Math.min(most_rpm, rpm));
}
