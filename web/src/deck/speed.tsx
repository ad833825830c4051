// Speed, and the speed limit that the operator chooses: one bar for both.

import { useEffect, useRef } from "preact/hooks";
import { isOnFloor } from "../drive/axes";
import { HeldPointer } from "../drive/held";
import { useSession } from "../session";
import { figure } from "../text/numbers";
import { words } from "../text/reasons";
import { texts } from "../text/text";
import { speedOf } from "./steps";

const LEAST = 0.05; // Of the limit of the robot.
const STEPS: Record<string, number> = {
  ArrowRight: 0.05,
  ArrowUp: 0.05,
  ArrowLeft: -0.05,
  ArrowDown: -0.05,
  PageUp: 0.2,
  PageDown: -0.2,
  Home: -1,
  End: 1,
};

export function Speed() {
  const { value, unit } = speedOf(useSession());
  return (
    <>
      <p class="hero">
        <span class="n">{figure(value, 2)}</span>
        <span class="u">{unit}</span>
      </p>
      <SpeedLimit />
    </>
  );
}

function SpeedLimit() {
  const session = useSession();
  const { drive, link } = session;
  const { deck } = texts();
  const node = useRef<HTMLDivElement>(null);
  const robot = link.robot.value;
  const limits = link.state.value?.status.limits;
  const unit_m = robot?.twist_scale_m ?? 1;
  // The bar ends where the robot does; below that it may allow less for now.
  const most = (robot?.limits.speed_mps ?? 0) / unit_m || 1;
  const active = (limits?.speed_mps ?? 0) / unit_m || most;
  const limit = drive.scale.value.speed;
  const set = (level: number) => {
    drive.level.value = Math.round(100 * Math.max(LEAST, Math.min(1, level))) / 100;
  };
  const place = useRef(set);
  place.current = (share: number) => set((share * most) / active);
  useEffect(() => {
    const follow = ({ clientX }: PointerEvent) => {
      const { left, width } = node.current!.getBoundingClientRect();
      place.current((clientX - left) / Math.max(1, width));
    };
    const pointer = new HeldPointer(node.current!, { came: follow, moved: follow, gone: () => {} });
    return () => pointer.end();
  }, []);
  const key = (event: KeyboardEvent) => {
    const step = STEPS[event.code];
    if (step === undefined) return;
    event.preventDefault();
    set(drive.level.peek() + step);
  };
  const { value } = speedOf(session);
  const percent = (part: number) => `${100 * Math.max(0, Math.min(1, part / most))}%`;
  const unit = deck.units[isOnFloor(robot) ? "m/s" : "rad/s"];
  const why = limits?.why.map((reason) => words(reason)).join("; ") ?? "";
  return (
    <div
      ref={node}
      class="cap"
      role="slider"
      tabIndex={0}
      aria-label={deck.limit}
      aria-valuemin={LEAST * active}
      aria-valuemax={active}
      aria-valuenow={limit}
      aria-valuetext={`${figure(limit, 2)} ${unit}`}
      title={why === "" ? undefined : deck.slower(why)}
      style={{ "--limit": percent(limit) }}
      onKeyDown={key}
    >
      <span class="track">
        <i style={{ width: percent(value ?? 0) }} />
        <em />
      </span>
      <span class="handle" />
      <span class="lab">{deck.limitAt(figure(limit, 2))}</span>
    </div>
  );
}
