// Slider that stays where it is and moves no robot: square, with its value in the thumb.

import { figure } from "../text/numbers";

interface KnobSliderProps {
  label: string;
  value: number;
  most: number;
  decimals: number;
  unit: string;
  /** Whether it only follows from the other quantity. */
  follows?: boolean;
  ends?: boolean;
  onTurn: (value: number) => void;
}

const STEPS = 200;

export function KnobSlider(props: KnobSliderProps) {
  const { label, value, most, decimals, unit, follows, ends, onTurn } = props;
  const share = most > 0 ? Math.max(-1, Math.min(1, value / most)) : 0;
  const classes = ["js stay", share === 0 && "rest", follows && "follows"];
  return (
    <div class={classes.filter(Boolean).join(" ")} style={{ "--at": String(0.5 * share) }}>
      {ends && (
        <>
          <span class="end l">{figure(-most, most < 10 ? 1 : 0)}</span>
          <span class="end r">{figure(most, most < 10 ? 1 : 0)}</span>
        </>
      )}
      <span class="zero" />
      <span class="from" />
      <span class="thumb">{figure(value, decimals)}</span>
      <input
        type="range"
        aria-label={label}
        aria-valuetext={`${figure(value, decimals)} ${unit}`}
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
