// Small picture of a robot by its kind, seen from above with its front up.

import type { FleetRobot } from "../generated/wire";

interface PictureProps {
  panel: FleetRobot["panel"];
  wheels: number;
}

const AROUND_DEG: Record<number, readonly number[]> = {
  3: [0, 120, 240],
  4: [45, 135, 225, 315],
};

export function Picture({ panel, wheels }: PictureProps) {
  const at = AROUND_DEG[wheels] ?? AROUND_DEG[panel === "gimbals" ? 3 : 4] ?? [];
  return (
    <svg class="picture" viewBox="-30 -30 60 60" aria-hidden="true">
      {panel === "sphere" ? (
        <>
          <circle class="pic-wheel" r="20" />
          <path class="pic-body" d="M-20 0a20 8 0 0040 0a20 8 0 00-40 0z" />
        </>
      ) : (
        <>
          {at.map((angle) => (
            <g key={angle} transform={`rotate(${angle}) translate(0 -19)`}>
              {panel === "gimbals" ? (
                <circle class="pic-wheel" r="8" />
              ) : (
                <rect class="pic-wheel" x="-8" y="-3.5" width="16" height="7" rx="2" />
              )}
            </g>
          ))}
          <circle class="pic-body" r="16" />
        </>
      )}
      <path class="pic-front" d="M0-12l5 8h-10z" />
    </svg>
  );
}
