// Keys, wheel and pointers on the plots: zoom, pan, cursor, and seeking in a recording.

import type { PlotView } from "./view";

const ZOOM = 1.25;
const CLICK_SHARE = 0.01; // A pointer that moves by less of the width clicks.

/** Return the handlers of the area around the plots. */
export function gesturesOf(view: PlotView) {
  const pointers = new Map<number, { at: number; from: number }>();
  const share = ({ clientX }: MouseEvent) => {
    const { left, width } = [...view.charts][0]!.plot.over.getBoundingClientRect();
    return (clientX - left) / width;
  };
  const isOnPlot = ({ target }: Event) => (target as Element).closest(".u-over") !== null;
  return {
    onKeyDown: (event: KeyboardEvent) => takeKey(event, view),
    onWheel: (event: WheelEvent) => {
      if (!isOnPlot(event)) return;
      event.preventDefault();
      const across = event.deltaX || (event.shiftKey ? event.deltaY : 0);
      if (across !== 0) view.pan(Math.sign(across) / 10);
      else view.zoom(event.deltaY > 0 ? ZOOM : 1 / ZOOM, share(event));
    },
    onPointerDown: (event: PointerEvent) => {
      if (!isOnPlot(event) || event.button !== 0) return;
      pointers.set(event.pointerId, { at: share(event), from: share(event) });
    },
    onPointerMove: (event: PointerEvent) => {
      const mine = pointers.get(event.pointerId);
      const at = mine && share(event);
      if (!mine || at === undefined || Math.abs(at - mine.from) < CLICK_SHARE) return;
      (event.currentTarget as Element).setPointerCapture(event.pointerId);
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      if (other === undefined) view.pan(mine.at - at);
      else if (at !== other.at)
        view.zoom(Math.abs((mine.at - other.at) / (at - other.at)), (at + other.at) / 2);
      pointers.set(event.pointerId, { at, from: Infinity });
    },
    onPointerUp: ({ pointerId }: PointerEvent) => {
      const { at, from } = pointers.get(pointerId) ?? { at: 0, from: Infinity };
      pointers.delete(pointerId);
      const [fromS, toS] = view.span();
      if (at === from) view.seek(fromS + at * (toS - fromS));
    },
    onPointerCancel: ({ pointerId }: PointerEvent) => pointers.delete(pointerId),
  };
}

function takeKey(event: KeyboardEvent, view: PlotView): void {
  const atS = view.cursorS.peek();
  const actions: Record<string, () => void> = {
    "+": () => view.zoom(1 / ZOOM, 0.5),
    "-": () => view.zoom(ZOOM, 0.5),
    PageUp: () => view.pan(-0.5),
    PageDown: () => view.pan(0.5),
    ArrowLeft: () => moveCursor(view, -1),
    ArrowRight: () => moveCursor(view, 1),
    End: () => view.end(null),
    Enter: () => atS !== null && view.seek(atS),
  };
  const isOurs = event.target === event.currentTarget && event.key in actions;
  if (!isOurs || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  actions[event.key]!();
}

/** Move the cursor of all charts, by default from the middle. */
function moveCursor({ charts }: PlotView, pixels: number): void {
  for (const { plot } of charts) {
    const { left = -1 } = plot.cursor;
    const { width } = plot.over.getBoundingClientRect();
    const to = left < 0 ? width / 2 : Math.max(0, Math.min(width - 1, left + pixels));
    plot.setCursor({ left: to, top: 0 });
  }
}
