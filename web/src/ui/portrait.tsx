// Rendered picture of a robot, with a drawing as its placeholder.

import type { ComponentChild } from "preact";
import { useState } from "preact/hooks";

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
