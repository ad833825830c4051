// Values of sliders for assistive technology, and a slider over a whole track, for pointer and keys.

import type { TargetedPointerEvent } from "preact";

/** Attributes of a slider; `text` is its value in words. */
export function sliderValue(least: number, most: number, now: number, text: string) {
  return {
    role: "slider",
    tabIndex: 0,
    "aria-valuemin": least,
    "aria-valuemax": most,
    "aria-valuenow": now,
    "aria-valuetext": text,
  } as const;
}

type Pointer = TargetedPointerEvent<HTMLElement>;

const KEYS: Record<string, number> = {
  ArrowLeft: -1,
  ArrowDown: -1,
  ArrowRight: 1,
  ArrowUp: 1,
  PageDown: -10,
  PageUp: 10,
};

/** Handlers of a slider: `seek` gets the fraction of the track, `move` the steps of a key. */
export function sliderHandlers(seek: (share: number) => void, move: (steps: number) => void) {
  const point = ({ currentTarget: track, pointerId, clientX }: Pointer) => {
    const { left, width } = track.getBoundingClientRect();
    if (track.hasPointerCapture(pointerId)) seek(shareAt(clientX, left, width));
  };
  return {
    onPointerDown: (event: Pointer) => {
      if (event.button !== 0) return;
      event.currentTarget.setPointerCapture(event.pointerId);
      point(event);
    },
    onPointerMove: point,
    onKeyDown: (event: KeyboardEvent) => {
      const steps = KEYS[event.code];
      if (steps !== undefined) move(steps);
      else if (event.code === "Home") seek(0);
      else if (event.code === "End") seek(1);
      else return;
      event.preventDefault();
      event.stopPropagation();
    },
  };
}

export function shareAt(x: number, start: number, length: number): number {
  return length > 0 ? Math.max(0, Math.min(1, (x - start) / length)) : 0;
}
