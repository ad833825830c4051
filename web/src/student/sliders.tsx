// Twist and joints of the setting: whichever is moved, the other follows.

import { useMemo } from "preact/hooks";
import type { StudentFigures } from "../generated/wire";
import { figure, texts } from "../text/text";
import { Quantity } from "../ui/figure";
import type { StudentModel } from "./model";
import { decimalsOf } from "./results";

export interface PartProps {
  model: StudentModel;
  figures: StudentFigures;
}

export function Twist({ model, figures }: PartProps) {
  const { student } = texts();
  const { joints, twist } = model.setting.value;
  const shown = joints === null ? twist : figures.twist;
  return (
    <section class={joints === null ? "sec" : "sec follows"} aria-label={student.twist}>
      <h2>
        {student.twist} <small>{student.toJoints}</small>
      </h2>
      {figures.axes.map(({ name, symbol, unit }, i) => (
        <div class="axis" key={name}>
          <div class="h">
            <b>{student.axes[name] ?? symbol}</b>
            <span>
              <Quantity symbol={symbol} /> {student.inUnit("", unit).trim()}
            </span>
          </div>
          <KnobSlider
            label={student.axes[name] ?? symbol}
            value={shown[i] ?? 0}
            most={roundEnd(figures.tops[i] ?? 1)}
            unit={unit}
            onTurn={(value) => model.move(i, value)}
          />
        </div>
      ))}
    </section>
  );
}

export function Joints({ model, figures }: PartProps) {
  const { student } = texts();
  const { joints } = model.setting.value;
  const rows = model.joints();
  const isGimbal = figures.wheels[0]?.gimbal != null;
  const tilt = model.reply.value?.knobs.find(({ key }) => key.endsWith("max_tilt_deg"));
  const fastest = Math.max(1, ...rows.map((row) => Math.abs(row.at(-1) ?? 0)));
  // The range must not move under a hand that drags.
  const usual = useMemo(() => roundEnd(2 * fastest), [figures.wheels.length, isGimbal]);
  const { columns, unit, most } = isGimbal
    ? { columns: ["α", "β"], unit: "°", most: tilt?.value ?? 30 }
    : { columns: ["φ̇"], unit: "rpm", most: Math.max(usual, fastest) };
  return (
    <section class={joints === null ? "sec follows" : "sec"} aria-label={student.joints}>
      <h2>
        {student.joints} <small>{student.toTwist}</small>
      </h2>
      <div class={isGimbal ? "gim" : "gim one"}>
        <span />
        {columns.map((column) => (
          <span class="h note" key={column}>
            {student.inUnit(column, unit)}
          </span>
        ))}
        {rows.map((row, i) => [
          <b key={i}>{i + 1}</b>,
          ...columns.map((column, j) => (
            <KnobSlider
              key={`${i} ${column}`}
              label={student.jointOf(column, i + 1)}
              value={row[j] ?? 0}
              most={most}
              unit={unit}
              onTurn={(value) => model.bend(i, j, value)}
            />
          )),
        ])}
      </div>
      <p class="note">{contradiction(figures)}</p>
    </section>
  );
}

function contradiction({ redundancy, residual_mps }: StudentFigures): string {
  const { student } = texts();
  if (redundancy === 0) return student.noContradiction;
  if (residual_mps === 0) return student.tryContradiction;
  return student.contradiction(figure(1000 * residual_mps, 1));
}

/** Round up to a plain number of two digits, for the ends of a slider. */
function roundEnd(value: number): number {
  return Number((1.05 * value).toPrecision(2));
}

const STEPS = 200;

interface KnobSliderProps {
  label: string;
  value: number;
  most: number;
  unit: string;
  onTurn: (value: number) => void;
}

/** Slider that stays where it is and moves no robot: square, with its value in the thumb. */
function KnobSlider({ label, value, most, unit, onTurn }: KnobSliderProps) {
  const share = most > 0 ? Math.max(-1, Math.min(1, value / most)) : 0;
  const end = figure(most, most < 10 ? 1 : 0);
  const shown = figure(value, decimalsOf(most));
  return (
    <div class={share === 0 ? "js stay rest" : "js stay"} style={{ "--at": String(0.5 * share) }}>
      <span class="end l">−{end}</span>
      <span class="end r">{end}</span>
      <span class="zero" />
      <span class="from" />
      <span class="thumb">{shown}</span>
      <input
        type="range"
        aria-label={label}
        aria-valuetext={`${shown} ${unit}`}
        min={-most}
        max={most}
        step={most / STEPS}
        value={value}
        onInput={(event) => onTurn(event.currentTarget.valueAsNumber)}
        onDblClick={() => onTurn(0)}
      />
    </div>
  );
}
