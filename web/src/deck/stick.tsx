// Stick and turn slider: the knob is what you ask, the dot what the robot makes of it.

import { useMemo } from "preact/hooks";
import { type Deflection, isOnFloor, limited, onScreen, scaled } from "../drive/axes";
import { SprungControl } from "../drive/sprung";
import { useSession } from "../session";
import { currentState } from "../store/freshness";
import { degrees, figure, texts } from "../text/text";
import { Button } from "../ui/button";
import { sliderValue } from "../ui/slider";
import { SprungSlider, useSprungSlider } from "../ui/sprung_slider";
import { unitOf, whyOff } from "./steps";

const SIZE = 132; // Units of the drawing.
const RIM = 64;
const KNOB = 21;
const REACH = RIM - KNOB; // The knob stays inside.
const ARROWS = {
  ArrowUp: { x: 1 },
  ArrowDown: { x: -1 },
  ArrowLeft: { y: 1 },
  ArrowRight: { y: -1 },
};

function read({ clientX, clientY }: PointerEvent, { left, top, width, height }: DOMRect) {
  const reach = (REACH / SIZE) * Math.max(1, width);
  const right = (clientX - left - width / 2) / reach;
  const down = (clientY - top - height / 2) / reach;
  return limited({ x: -down, y: -right, turn: 0 });
}

function spokenOf(axis: keyof Deflection, value: number, unit: "m/s" | "rad/s"): string {
  const { deck } = texts();
  const shown = figure(Math.abs(value), 2);
  if (shown === figure(0, 2)) return deck.zero;
  const way = deck.ways[axis === "x" ? "ahead" : "aside"][value > 0 ? 0 : 1];
  return `${shown} ${deck.units[unit]} ${way}`;
}

export function Stick() {
  const session = useSession();
  const { drive } = session;
  const { deck } = texts();
  const control = useMemo(() => new SprungControl(drive, read, ARROWS), [drive]);
  const off = whyOff(session);
  const classes = ["stick", off && "off", drive.looksOnly.value && "looks"];
  return (
    <div class="stickcell">
      <div
        ref={control.attach}
        class={classes.filter(Boolean).join(" ")}
        role="application"
        aria-roledescription={deck.stickRole}
        aria-label={deck.stick}
        aria-disabled={off !== null || undefined}
        title={off?.text}
        tabIndex={0}
      >
        <Face />
        <HiddenSlider axis="x" />
        <HiddenSlider axis="y" />
      </div>
      <Axes />
    </div>
  );
}

/** One direction of the stick, for those who cannot see it. */
function HiddenSlider({ axis }: { axis: "x" | "y" }) {
  const { drive, link } = useSession();
  const control = useSprungSlider(drive, axis);
  const most = drive.scale.value.speed;
  const value = drive.asked.value[axis];
  return (
    <div
      ref={control.attach}
      class="sr"
      aria-label={texts().deck.axes[axis]}
      {...sliderValue(-most, most, value, spokenOf(axis, value, unitOf(link)))}
    />
  );
}

function Face() {
  const { drive, link } = useSession();
  const { speed } = drive.scale.value;
  const shareOf = (each: Deflection) => limited(scaled(each, speed > 0 ? 1 / speed : 0));
  const asked = shareOf(drive.asked.value);
  const allowed = drive.allowed.value && shareOf(drive.allowed.value);
  const knob = onScreen(scaled(asked, REACH));
  const dot = onScreen(scaled(allowed ?? asked, REACH));
  const length = Math.hypot(asked.x, asked.y);
  // A ring only where the robot allows less than was chosen.
  const part = link.state.value?.status.limits.applied ?? 1;
  const holdsBack = length > 0 && !drive.looksOnly.value && part < 0.98;
  const moves = Math.max(length, Math.hypot(allowed?.x ?? 0, allowed?.y ?? 0)) > 0.01;
  return (
    <svg viewBox="-66 -66 132 132" aria-hidden="true">
      <circle class="st-rim" r={RIM} />
      <path class="st-cross" d="M-58 0H58M0-58V58" />
      {holdsBack && <circle class="st-cap" r={REACH * length * part} />}
      <Marks />
      <circle class="st-knob" cx={knob.right} cy={knob.down} r={KNOB} />
      {allowed && moves && (
        <>
          <path class="st-line" d={`M${dot.right} ${dot.down}L${knob.right} ${knob.down}`} />
          <circle class="st-dot" cx={dot.right} cy={dot.down} r="5" />
        </>
      )}
    </svg>
  );
}

/** Where front of the robot and x of the world are, along the axes of the stick. */
function Marks() {
  const { drive, link } = useSession();
  const state = currentState(link);
  const heading = state?.pose?.[2] ?? null;
  const isWorld = drive.frame.value === "odom";
  const front = isWorld ? heading : 0;
  const world = isWorld ? state && 0 : heading && -heading;
  const at = (angle: number, radius: number) => {
    const { right, down } = onScreen({ x: radius * Math.cos(angle), y: radius * Math.sin(angle) });
    return `translate(${right} ${down})`;
  };
  return (
    <>
      {world !== null && (
        <text class="st-t world-x" y="4" transform={at(world, 41)}>
          x
        </text>
      )}
      {front !== null && (
        <path
          class="st-front"
          d="M0-4L4 3H-4z"
          transform={`${at(front, 59)} rotate(${-(degrees(front) ?? 0)})`}
        />
      )}
    </>
  );
}

/** Changes between the axes of the robot and of the floor. */
function Axes() {
  const { drive, link } = useSession();
  const { deck } = texts();
  if (!isOnFloor(link.robot.value)) return null;
  const frame = drive.frame.value;
  return (
    <Button
      class="frame"
      edge
      label={`${deck.axesOf} ${deck[frame]}. ${deck.changeAxes}`}
      onPress={() => drive.setFrame(frame === "odom" ? "base_link" : "odom")}
    >
      <small>{deck.axesOf}</small> <b>{deck[frame]}</b>
    </Button>
  );
}

/** Slider that turns; left turns left, counter-clockwise seen from above. */
export function Turn() {
  const session = useSession();
  const { drive } = session;
  const label = texts().deck.axes.turn;
  const control = useSprungSlider(drive, "turn", true);
  const off = whyOff(session);
  const { turn } = drive.asked.value;
  return (
    <div class="turn">
      <SprungSlider
        label={label}
        control={control}
        asked={turn}
        allowed={drive.allowed.value?.turn ?? null}
        most={drive.scale.value.turn}
        spoken={spokenOf("turn", turn, "rad/s")}
        mirrored
        ends={["‹", "›"]}
        refused={off?.text}
        looksOnly={drive.looksOnly.value}
      />
      <span class="labs">
        <span>{label}</span> <span class="lab">{off?.short ?? "rad/s"}</span>
      </span>
    </div>
  );
}
