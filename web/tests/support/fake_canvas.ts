// Canvases for a DOM that has none: they take every call and draw nothing.

import { vi } from "vitest";

export function fakeCanvas(): void {
  const pen: object = new Proxy({}, { get: () => () => pen, set: () => true });
  vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockReturnValue(pen as never);
  vi.spyOn(HTMLElement.prototype, "clientWidth", "get").mockReturnValue(600);
  vi.stubGlobal(
    "Path2D",
    class {
      moveTo() {}
      lineTo() {}
      rect() {}
      arc() {}
    },
  );
}
