// Start of the view until the scene is drawn: the robot's portrait, its name, and the progress. It
// does not block STOP.

import { useEffect, useState } from "preact/hooks";
import type { RobotInfo } from "../generated/wire";
import { useSession } from "../session";
import { freshness } from "../store/freshness";
import { texts } from "../text/text";
import { Portrait } from "../ui/portrait";
import type { Viewport } from "../viewport/frame";

const STEPS = ["connecting", "robot", "loading", "drawing"] as const;
const SLOW_MS = 30_000; // Without WebGL it never appears.

export function Splash({ viewport }: { viewport: Viewport }) {
  const { link } = useSession();
  const { splash } = texts().scene;
  const [slow, setSlow] = useState(false);
  useEffect(() => {
    const timer = setTimeout(() => setSlow(true), SLOW_MS);
    return () => clearTimeout(timer);
  }, []);
  const robot = link.robot.value;
  const at = [link.connected.value, robot !== null, viewport.loaded.value, false].indexOf(false);
  const noRobot = freshness(link).kind === "no_robot";
  const step = slow && viewport.loaded.value ? "slow" : STEPS[at]!;
  return (
    <div class="splash" role="group" aria-label={splash.label}>
      {robot && !link.recording ? (
        <Portrait robot={robot.id}>
          <Silhouette robot={robot} />
        </Portrait>
      ) : (
        <Silhouette robot={robot} />
      )}
      {robot && (
        <strong>
          <bdi>{robot.title}</bdi>
        </strong>
      )}
      <p role="status">{noRobot ? texts().common.refusals.no_robot : splash[step]}</p>
      <progress max={STEPS.length} value={at} aria-label={splash.label} />
    </div>
  );
}

/** Outline of a robot from above: a ball, or a body among its wheels. */
function Silhouette({ robot }: { robot: RobotInfo | null }) {
  const count = robot ? robot.modules.length || robot.wheels.length : 0;
  const isRound = robot?.panel === "sphere";
  const turned = (i: number) => `rotate(${((i + (count === 4 ? 0.5 : 0)) * 360) / count})`;
  return (
    <svg class="silhouette" viewBox="-50 -50 100 100" aria-hidden="true">
      <circle r={isRound ? 40 : 26} />
      {!isRound &&
        Array.from({ length: count }, (_, i) => (
          <rect key={i} x="-13" y="-46" width="26" height="20" rx="9" transform={turned(i)} />
        ))}
    </svg>
  );
}
