// Speed, and the speed limit that the operator chooses: one bar for both.

import { useSession } from "../session";
import { figure } from "../text/numbers";
import { words } from "../text/reasons";
import { texts } from "../text/text";
import { sliderHandlers } from "../timeline/slider";
import { speedOf, unitOf } from "./steps";

const LEAST = 0.05; // Of the limit of the robot.
const STEP = 0.05;

export function Speed() {
  const { drive, link } = useSession();
  const { deck } = texts();
  const [speed, unit] = [speedOf(link), unitOf(link)];
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
  const handlers = sliderHandlers(
    (share) => set((share * most) / active),
    (steps) => set(drive.level.peek() + STEP * Math.max(-4, Math.min(4, steps))),
  );
  const percent = (part: number) => `${100 * Math.max(0, Math.min(1, part / most))}%`;
  const why = limits?.why.map((reason) => words(reason)).join("; ") ?? "";
  return (
    <>
      <p class="hero">
        <span class="n">{figure(speed, 2)}</span>
        <span class="u">{unit}</span>
      </p>
      <div
        {...handlers}
        class="cap"
        aria-label={deck.limit}
        aria-valuemin={LEAST * active}
        aria-valuemax={active}
        aria-valuenow={limit}
        aria-valuetext={`${figure(limit, 2)} ${deck.units[unit]}`}
        title={why === "" ? undefined : deck.slower(why)}
        style={{ "--limit": percent(limit) }}
      >
        <span class="track">
          <i style={{ width: percent(speed ?? 0) }} />
          <em />
        </span>
        <span class="handle" />
        <span class="lab">{deck.limitAt(figure(limit, 2))}</span>
      </div>
    </>
  );
}
