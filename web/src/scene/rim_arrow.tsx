// An arrow at the rim of the picture towards a robot outside it; a click brings the robot back.

import { useComputed } from "@preact/signals";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { texts } from "../text/text";

const ACROSS = 42; // Half axes of the ellipse on which it moves, in percent.
const DOWN = 36;

export function RimArrow() {
  const { link, view } = useSession();
  const directionRad = useComputed(() => link.state.value?.camera?.off_screen_rad ?? null).value;
  if (directionRad === null || link.beat.value < 0 || !isCurrent(freshness(link))) return null;
  const left = 50 + ACROSS * Math.cos(directionRad);
  const top = 50 - DOWN * Math.sin(directionRad);
  return (
    <button
      type="button"
      class="chip rim-arrow"
      aria-label={texts().scene.home}
      title={texts().scene.home}
      style={{ left: `${left.toFixed(1)}%`, top: `${top.toFixed(1)}%` }}
      onClick={() => view.set({}, true)}
    >
      <svg
        class="i"
        viewBox="0 0 24 24"
        aria-hidden="true"
        style={{ rotate: `${-directionRad}rad` }}
      >
        <path d="M4 12h15M13 6l6 6-6 6" />
      </svg>
    </button>
  );
}
