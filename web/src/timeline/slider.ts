// What both timelines share: a slider over the whole lane, for pointer and keys.

import type { TargetedPointerEvent } from "preact";

const KEYS: Record<string, number> = {
  ArrowLeft: -1,
  ArrowDown: -1,
  ArrowRight: 1,
  ArrowUp: 1,
  PageDown: -10,
  PageUp: 10,
};

/** Handlers of a slider: `seek` gets the share of the lane, `move` seconds, `end` 0 or 1. */
export function sliderHandlers(seek: (share: number) => void, move: (seconds: number) => void) {
  const point = (event: TargetedPointerEvent<HTMLElement>) => {
    const box = event.currentTarget.getBoundingClientRect();
    seek(shareAt(event.clientX, box.left, box.width));
  };
  return {
    role: "slider" as const,
    tabIndex: 0,
    onPointerDown: (event: TargetedPointerEvent<HTMLElement>) => {
      if (event.button !== 0) return;
      event.currentTarget.setPointerCapture(event.pointerId);
      point(event);
    },
    onPointerMove: (event: TargetedPointerEvent<HTMLElement>) => {
      if (event.currentTarget.hasPointerCapture(event.pointerId)) point(event);
    },
    onKeyDown: (event: KeyboardEvent) => {
      const seconds = KEYS[event.code];
      if (seconds !== undefined) move(seconds);
      else if (event.code === "Home") seek(0);
      else if (event.code === "End") seek(1);
      else return;
      event.preventDefault();
      event.stopPropagation();
    },
  };
}

export function shareAt(x: number, left: number, width: number): number {
  return width > 0 ? Math.max(0, Math.min(1, (x - left) / width)) : 0;
}
