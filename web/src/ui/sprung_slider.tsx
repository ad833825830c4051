// Slider that springs back to zero: in the middle, with its value inside the thumb.

import { useMemo } from "preact/hooks";
import { CENTRED, type Deflection } from "../drive/axes";
import { type Holder, SprungControl } from "../drive/sprung";
import { figure } from "../text/numbers";

export interface SprungSliderProps {
  label: string;
  /** Component of the command that it changes. */
  axis: keyof Deflection;
  /** Control behind it; `useSprungSlider` makes one. */
  control: SprungControl;
  /** Value asked by all controls, allowed value or null, and the value at the ends. */
  asked: number;
  allowed: number | null;
  most: number;
  unit: string;
  /** Value in words for a screen reader. */
  spoken: string;
  /** Whether the positive end is on the left, as for turning left. */
  mirrored?: boolean;
  ends?: readonly [string, string];
  off?: boolean;
  /** Why it does not act now, or null. */
  refused?: string | null;
  looksOnly?: boolean;
}

/** Share of the way, 0.5 at most, from which the thumb may cover the figure of that end. */
const COVERS = 0.24;

/** Return a control for one component of the command. */
export function useSprungSlider(drive: Holder, axis: keyof Deflection, mirrored = false) {
  return useMemo(() => {
    const way = mirrored ? -1 : 1;
    const along = (share: number): Deflection => ({
      ...CENTRED,
      [axis]: Math.max(-1, Math.min(1, way * share)),
    });
    const read = (event: PointerEvent, box: DOMRect) => {
      const track = event.currentTarget as HTMLElement;
      const thumb = track.querySelector<HTMLElement>(".thumb")?.offsetWidth ?? 0;
      return along((2 * (event.clientX - box.left) - box.width) / Math.max(1, box.width - thumb));
    };
    return new SprungControl(drive, read, {
      ArrowRight: along(1),
      ArrowLeft: along(-1),
      ArrowUp: { [axis]: 1 },
      ArrowDown: { [axis]: -1 },
    });
  }, [drive, axis, mirrored]);
}

export function SprungSlider(props: SprungSliderProps) {
  const { label, control, asked, allowed, most, spoken, mirrored, off } = props;
  const at = (value: number) => {
    const share = most > 0 ? Math.max(-1, Math.min(1, value / most)) : 0;
    return (mirrored ? -share : share) * 0.5;
  };
  const decimals = most >= 10 ? 1 : 2;
  const ends = props.ends ?? [
    figure(mirrored ? most : -most, 1),
    figure(mirrored ? -most : most, 1),
  ];
  const differs = allowed !== null && Math.abs(allowed - asked) > 0.02 * most;
  const rests = asked === 0 && !control.held;
  const classes = ["js", rests && "rest", off && "off", props.looksOnly && "looks"];
  const place = (name: string, share: number) => ({ [name]: String(share) });
  return (
    <div
      ref={control.attach}
      class={classes.filter(Boolean).join(" ")}
      role="slider"
      tabIndex={0}
      aria-label={label}
      aria-disabled={off || undefined}
      title={props.refused ?? undefined}
      aria-valuemin={-most}
      aria-valuemax={most}
      aria-valuenow={asked}
      aria-valuetext={spoken}
      style={{ ...place("--at", at(asked)), ...place("--allowed", at(allowed ?? 0)) }}
    >
      {at(asked) > -COVERS && <span class="end l">{ends[0]}</span>}
      {at(asked) < COVERS && <span class="end r">{ends[1]}</span>}
      <span class="zero" />
      <span class="from" />
      {differs && <span class="allowed" />}
      <span class="thumb">{figure(asked, decimals)}</span>
    </div>
  );
}
