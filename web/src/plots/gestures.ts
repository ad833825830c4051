// Keys, wheel and pointers on the plots: zoom, pan, cursor, and seeking in a recording.

import type { Shared } from "./plots";

const ZOOM = 1.25;
const CLICK_SHARE = 0.01; // A pointer that moves by less of the width clicks.

/** Take a key of the area around the plots. */
export function keys(event: KeyboardEvent, { view, charts }: Shared): void {
  const at = view.cursorS.peek();
  const actions: Record<string, () => void> = {
    "+": () => view.zoom(1 / ZOOM, 0.5),
    "-": () => view.zoom(ZOOM, 0.5),
    PageUp: () => view.pan(-0.5),
    PageDown: () => view.pan(0.5),
    ArrowLeft: () => moveCursor(charts, -1),
    ArrowRight: () => moveCursor(charts, 1),
    End: () => view.pause(false),
    Enter: () => at !== null && view.seek(at),
  };
  const isOurs = event.target === event.currentTarget && event.key in actions;
  if (!isOurs || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  actions[event.key]!();
}

/** Move the cursor of all charts, by default from the middle. */
function moveCursor(charts: Shared["charts"], pixels: number): void {
  for (const { plot } of charts) {
    const { left = -1 } = plot.cursor;
    const { width } = plot.over.getBoundingClientRect();
    const to = left < 0 ? width / 2 : Math.max(0, Math.min(width - 1, left + pixels));
    plot.setCursor({ left: to, top: 0 });
  }
}

/** Pan by one pointer, zoom by two or the wheel; a click seeks. Return a function that ends it. */
export function listen(area: HTMLElement, { view, charts }: Shared): () => void {
  const controller = new AbortController();
  const on = <K extends keyof HTMLElementEventMap>(
    type: K,
    listener: (event: HTMLElementEventMap[K]) => void,
  ) => area.addEventListener(type, listener, { passive: false, signal: controller.signal });
  const pointers = new Map<number, { at: number; from: number }>();
  const isOnPlot = ({ target }: Event) => target instanceof Element && target.closest(".u-over");
  const share = ({ clientX }: MouseEvent) => {
    const { left, width } = [...charts][0]!.plot.over.getBoundingClientRect();
    return (clientX - left) / width;
  };
  on("wheel", (event) => {
    if (!isOnPlot(event)) return;
    event.preventDefault();
    const across = event.deltaX || (event.shiftKey ? event.deltaY : 0);
    if (across !== 0) view.pan(Math.sign(across) / 10);
    else view.zoom(event.deltaY > 0 ? ZOOM : 1 / ZOOM, share(event));
  });
  on("pointerdown", (event) => {
    if (!isOnPlot(event) || event.button !== 0) return;
    pointers.set(event.pointerId, { at: share(event), from: share(event) });
  });
  on("pointermove", (event) => {
    const mine = pointers.get(event.pointerId);
    const at = mine && share(event);
    if (!mine || at === undefined || Math.abs(at - mine.from) < CLICK_SHARE) return;
    area.setPointerCapture(event.pointerId);
    const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other === undefined) view.pan(mine.at - at);
    else if (at !== other.at)
      view.zoom(Math.abs((mine.at - other.at) / (at - other.at)), (at + other.at) / 2);
    pointers.set(event.pointerId, { at, from: Infinity });
  });
  on("pointerup", ({ pointerId }) => {
    const mine = pointers.get(pointerId);
    pointers.delete(pointerId);
    const [fromS, toS] = view.span();
    if (mine?.from === mine?.at && mine) view.seek(fromS + mine.at * (toS - fromS));
  });
  on("pointercancel", ({ pointerId }) => pointers.delete(pointerId));
  on("dblclick", () => view.pause(false));
  return () => controller.abort();
}
