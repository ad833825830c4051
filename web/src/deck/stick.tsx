// Stick: the knob is what you ask, the dot what the robot makes of it.

import { useEffect, useMemo, useRef } from "preact/hooks";
import { type Deflection, isOnFloor, limited, onScreen } from "../drive/axes";
import { SprungControl } from "../drive/sprung";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { useSprungSlider } from "../ui/sprung_slider";
import { whyOff } from "./steps";

const SIZE = 132; // Of the drawing.
const RIM = 64;
const KNOB = 21;
const REACH = RIM - KNOB; // The knob stays inside.
const ARROWS = {
  ArrowUp: [1, 0, 0],
  ArrowDown: [-1, 0, 0],
  ArrowLeft: [0, 1, 0],
  ArrowRight: [0, -1, 0],
} as const;

/** Component of a command in words. */
export function spokenOf(axis: keyof Deflection, value: number, unit: "m/s" | "rad/s"): string {
  const { deck } = texts();
  const shown = figure(Math.abs(value), 2);
  if (shown === figure(0, 2)) return deck.zero;
  return `${shown} ${deck.units[unit]} ${deck.ways[axis === "x" ? "ahead" : "aside"][value > 0 ? 0 : 1]}`;
}

export function Stick() {
  const session = useSession();
  const { drive, link } = session;
  const { deck } = texts();
  const pad = useRef<HTMLDivElement>(null);
  const control = useMemo(() => {
    const read = (event: PointerEvent, { left, top, width, height }: DOMRect) => {
      const reach = (REACH / SIZE) * Math.max(1, width);
      const right = (event.clientX - left - width / 2) / reach;
      const down = (event.clientY - top - height / 2) / reach;
      return limited({ x: -down, y: -right, turn: 0 });
    };
    return new SprungControl(drive, read, ARROWS);
  }, [drive]);
  useEffect(() => control.attach(pad.current!), [control]);
  const off = whyOff(session);
  const unit = isOnFloor(link.robot.value) ? "m/s" : "rad/s";
  const classes = ["stick", off && "off", drive.looksOnly.value && "looks"];
  return (
    <div class="stickcell">
      <div
        ref={pad}
        class={classes.filter(Boolean).join(" ")}
        role="application"
        aria-roledescription={deck.stickRole}
        aria-label={deck.stick}
        aria-disabled={off !== null || undefined}
        title={off?.text}
        tabIndex={0}
      >
        <Face />
        <HiddenSlider axis="x" unit={unit} />
        <HiddenSlider axis="y" unit={unit} />
      </div>
      <Axes />
    </div>
  );
}

/** One direction of the stick, for those who cannot see it. */
function HiddenSlider({ axis, unit }: { axis: "x" | "y"; unit: "m/s" | "rad/s" }) {
  const { drive } = useSession();
  const { deck } = texts();
  const node = useRef<HTMLDivElement>(null);
  const control = useSprungSlider(drive, axis);
  useEffect(() => control.attach(node.current!), [control]);
  const most = drive.scale.value.speed;
  const value = drive.asked.value[axis];
  return (
    <div
      ref={node}
      class="sr"
      role="slider"
      tabIndex={0}
      aria-label={deck.axes[axis]}
      aria-valuemin={-most}
      aria-valuemax={most}
      aria-valuenow={value}
      aria-valuetext={spokenOf(axis, value, unit)}
    />
  );
}

function Face() {
  const { drive, link } = useSession();
  const { speed } = drive.scale.value;
  const shares = ({ x, y }: Deflection) =>
    limited({ x: speed > 0 ? x / speed : 0, y: speed > 0 ? y / speed : 0, turn: 0 });
  const asked = shares(drive.asked.value);
  const allowed = drive.allowed.value === null ? null : shares(drive.allowed.value);
  const [knob, dot] = [asked, allowed ?? asked].map((each) => {
    const { right, down } = onScreen(each);
    return { x: REACH * right, y: REACH * down };
  }) as [Point, Point];
  const length = Math.hypot(asked.x, asked.y);
  // A ring only where the robot allows less than was chosen.
  const part = link.state.value?.status.limits.applied ?? 1;
  const holdsBack = length > 0 && !drive.looksOnly.value && part < 0.98;
  const shows = allowed !== null && Math.max(length, Math.hypot(allowed.x, allowed.y)) > 0.01;
  return (
    <svg viewBox="-66 -66 132 132" aria-hidden="true">
      <circle class="st-rim" r={RIM} />
      <path class="st-cross" d="M-58 0H58M0-58V58" />
      {holdsBack && <circle class="st-cap" r={REACH * length * part} />}
      <Marks />
      <circle class="st-knob" cx={knob.x} cy={knob.y} r={KNOB} />
      {shows && <path class="st-line" d={`M${dot.x} ${dot.y}L${knob.x} ${knob.y}`} />}
      {shows && <circle class="st-dot" cx={dot.x} cy={dot.y} r="5" />}
    </svg>
  );
}

interface Point {
  x: number;
  y: number;
}

/** Where front of the robot and x of the world are, along the axes of the stick. */
function Marks() {
  const { drive, link } = useSession();
  void link.beat.value;
  const onFloor = isOnFloor(link.robot.value);
  const known = isCurrent(freshness(link)) && onFloor;
  const heading = known ? (link.state.value?.pose?.[2] ?? null) : null;
  const isWorld = drive.frame.value === "odom";
  const at = (angle: number, radius: number) => {
    const { right, down } = onScreen({ x: Math.cos(angle), y: Math.sin(angle) });
    return `translate(${radius * right} ${radius * down})`;
  };
  const front = isWorld ? heading : 0;
  const world = isWorld ? 0 : heading === null ? null : -heading;
  return (
    <>
      {world !== null && known && (
        <text class="st-t world-x" y="4" transform={at(world, 49)}>
          x
        </text>
      )}
      {front !== null && (
        <path
          class="st-front"
          d="M0-4L4 3H-4z"
          transform={`${at(front, 59)} rotate(${(-front * 180) / Math.PI})`}
        />
      )}
    </>
  );
}

/** Changes between the axes of the robot and of the floor; a sphere has no floor. */
function Axes() {
  const { drive, link } = useSession();
  const { deck } = texts();
  const onFloor = isOnFloor(link.robot.value);
  useEffect(() => {
    if (!onFloor && drive.frame.peek() !== "base_link") drive.setFrame("base_link");
  }, [onFloor]);
  if (!onFloor) return null;
  const frame = drive.frame.value;
  const other = frame === "odom" ? "base_link" : "odom";
  return (
    <Button
      class="frame"
      edge
      label={`${deck.axesOf} ${deck[frame]}. ${deck.changeAxes}`}
      onPress={() => drive.setFrame(other)}
    >
      <small>{deck.axesOf}</small> <b>{deck[frame]}</b>
    </Button>
  );
}
