// Slider that springs back to zero: in the middle, with its value inside the thumb.

import { useMemo } from "preact/hooks";
import { CENTRED, type Deflection } from "../drive/axes";
import { type Holder, SprungControl } from "../drive/sprung";
import { figure } from "../text/text";
import { sliderValue } from "./slider";

interface SprungSliderProps {
  label: string;
  control: SprungControl;
  /** Value asked by all controls, allowed value or null, and the value at the ends. */
  asked: number;
  allowed: number | null;
  most: number;
  spoken: string;
  /** Whether the positive end is on the left, as for turning left. */
  mirrored?: boolean;
  ends?: readonly [string, string];
  /** Why it does not act now, or null. */
  refused?: string | null;
  looksOnly?: boolean;
}

/** Place of the thumb, 0.5 at most, from which it may cover the figure of that end. */
const COVERS = 0.24;

/** Return a control for one component of the command. */
export function useSprungSlider(drive: Holder, axis: keyof Deflection, mirrored = false) {
  return useMemo(() => {
    const way = mirrored ? -1 : 1;
    const along = (share: number): Deflection => ({ ...CENTRED, [axis]: clamped(way * share) });
    const read = ({ currentTarget, clientX }: PointerEvent, { left, width }: DOMRect) => {
      const thumb = (currentTarget as HTMLElement).querySelector<HTMLElement>(".thumb");
      const range = width - (thumb?.offsetWidth ?? 0);
      return along((2 * (clientX - left) - width) / Math.max(1, range));
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
  const { label, control, asked, allowed, most, spoken, mirrored, refused } = props;
  const way = mirrored ? -1 : 1;
  /** Place on the track, from -0.5 to 0.5. */
  const at = (value: number) => (most > 0 ? 0.5 * clamped((way * value) / most) : 0);
  const [left, right] = props.ends ?? [figure(-way * most, 1), figure(way * most, 1)];
  const differs = allowed !== null && Math.abs(allowed - asked) > 0.02 * most;
  const rests = asked === 0 && !control.held;
  const classes = ["js", rests && "rest", refused && "off", props.looksOnly && "looks"];
  return (
    <div
      ref={control.attach}
      class={classes.filter(Boolean).join(" ")}
      aria-label={label}
      aria-disabled={refused ? true : undefined}
      title={refused ?? undefined}
      {...sliderValue(-most, most, asked, spoken)}
      style={{ "--at": `${at(asked)}`, "--allowed": `${at(allowed ?? 0)}` }}
    >
      {at(asked) > -COVERS && <span class="end l">{left}</span>}
      {at(asked) < COVERS && <span class="end r">{right}</span>}
      <span class="zero" />
      <span class="from" />
      {differs && <span class="allowed" />}
      <span class="thumb">{figure(asked, most >= 10 ? 1 : 2)}</span>
    </div>
  );
}

const clamped = (share: number) => Math.max(-1, Math.min(1, share));
