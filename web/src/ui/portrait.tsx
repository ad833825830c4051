// Rendered picture of a robot, with a drawing as its placeholder.

import type { ComponentChild } from "preact";
import { useState } from "preact/hooks";
import type { RobotInfo } from "../generated/wire";

export function Portrait({ robot, children }: { robot: string; children: ComponentChild }) {
  const [loaded, setLoaded] = useState<string | null>(null);
  const isLoaded = loaded === robot;
  return (
    <>
      {!isLoaded && children}
      <img
        class="portrait"
        src={`portraits/${encodeURIComponent(robot)}`}
        alt=""
        hidden={!isLoaded}
        onLoad={() => setLoaded(robot)}
        onError={() => setLoaded(null)}
      />
    </>
  );
}

interface OutlineProps {
  panel: RobotInfo["panel"] | undefined;
  /** Number of modules or wheels. */
  wheels: number;
  class: string;
}

/** Robot from above, with its front up. */
export function Outline({ panel, wheels: count, class: classes }: OutlineProps) {
  const isSphere = panel === "sphere";
  const [height, corner] = panel === "gimbals" ? [16, 8] : [7, 2];
  const turned = (i: number) => `rotate(${((i + (count === 4 ? 0.5 : 0)) * 360) / count})`;
  const wheel = { x: -8, y: -19 - height / 2, width: 16, height, rx: corner };
  return (
    <svg class={classes} viewBox="-30 -30 60 60" aria-hidden="true">
      {Array.from({ length: isSphere ? 0 : count }, (_, i) => (
        <rect key={i} class="wheel" transform={turned(i)} {...wheel} />
      ))}
      <circle class="body" r={isSphere ? 20 : 16} />
      <path class="front" d="M0-12l5 8h-10z" />
    </svg>
  );
}
