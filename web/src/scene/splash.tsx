// Start of the view until the scene is drawn: the robot's portrait, its name, and the progress. It
// does not block STOP.

import { useEffect, useState } from "preact/hooks";
import { useSession } from "../session";
import { freshness } from "../store/freshness";
import { texts } from "../text/text";
import { Outline, Portrait } from "../ui/portrait";
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
  const wheels = robot?.modules.length || robot?.wheels.length || 0;
  const outline = <Outline class="silhouette" panel={robot?.panel} wheels={wheels} />;
  return (
    <div class="splash" role="group" aria-label={splash.label}>
      {robot && !link.recording ? <Portrait robot={robot.id}>{outline}</Portrait> : outline}
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
