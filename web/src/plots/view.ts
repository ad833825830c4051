// The time axis that all plots share: window, pause, cursor, seeking; when they are drawn; and the
// keys, wheel and pointers that change it.

import { computed, effect, type Signal, signal } from "@preact/signals";
import { freshness, isCurrent } from "../store/freshness";
import type { Link } from "../store/link";
import { duration, texts } from "../text/text";
import { clock } from "../timeline/clock";
import { drawCharts, moveCursor, shareOf } from "./chart";
import type { Recorder } from "./recorder";

const SLOWEST_FRAME_MS = 500;
const HALF_BEAT_MS = 50;
const ZOOM = 1.25;
const CLICK_SHARE = 0.01; // A pointer that moves by less of the width clicks.

export class PlotView {
  /** Robot time under the cursor. */
  readonly cursorS = signal<number | null>(null);
  /** Name of the field that is dragged. */
  readonly dragged = signal<string | null>(null);
  /** Number of drawn pictures, which updates the legend. */
  readonly frame = signal(0);
  readonly isStale = computed(() => !isCurrent(freshness(this.link)));
  #asked = 0;
  #drawnMs = -Infinity;

  constructor(
    readonly recorder: Recorder,
    readonly link: Link,
  ) {}

  /** Robot time at both edges. */
  span(): [number, number] {
    const endS = this.recorder.endS.peek() ?? this.recorder.nowS();
    return [endS - this.recorder.layout.peek().windowS, endS];
  }

  /** Value of a field at the cursor, or the latest one while it is current; else null. */
  value(name: string): number | null {
    const { buffer, endS } = this.recorder;
    void this.frame.value;
    if (this.cursorS.value === null && endS.value === null && this.isStale.value) return null;
    const atS = this.cursorS.value ?? this.span()[1];
    return buffer.values(name)[buffer.places(-Infinity, atS)[1] - 1] ?? null;
  }

  /** Pause with this right edge within the recorded time, or resume. */
  end(endS: number | null): void {
    const [oldestS] = this.recorder.buffer.times;
    const isLive = endS === null || oldestS === undefined;
    // A sample that arrives late must not change a paused plot.
    const { newestS } = this.recorder.buffer;
    this.recorder.endS.value = isLive ? null : Math.max(oldestS, Math.min(newestS, endS));
  }

  /** Zoom about a position, 0 at the left edge; unless paused, the right edge stays at now. */
  zoom(factor: number, at: number): void {
    const [fromS, toS] = this.span();
    this.recorder.choose({ windowS: (toS - fromS) * factor });
    if (this.recorder.endS.peek() === null) return;
    const { windowS } = this.recorder.layout.peek();
    this.end(fromS + at * (toS - fromS) + (1 - at) * windowS);
  }

  /** Move by a fraction of the window. */
  pan(share: number): void {
    this.end(this.span()[1] + share * this.recorder.layout.peek().windowS);
  }

  /** In a recording, show the moment of a robot time; the plots then end there. */
  seek(robotS: number): void {
    const { offsetS, endS } = this.recorder;
    if (this.link.recording === null || Number.isNaN(offsetS)) return;
    endS.value = null;
    this.link.send({ t: "seek", t_s: Math.max(0, robotS + offsetS) });
  }

  /** Lines of the time axis: relative to now, or at round times. */
  splits(fromS: number, toS: number, stepS: number): number[] {
    const offsetS = this.#isRelative() ? -toS : this.recorder.offsetS;
    const first = Math.ceil((fromS + offsetS) / stepS - 1e-6);
    const count = Math.floor((toS + offsetS) / stepS + 1e-6) - first + 1;
    return Array.from({ length: Math.max(0, count) }, (_, i) => (first + i) * stepS - offsetS);
  }

  /** Time before now, time of day, or time in the recording. */
  timeText(atS: number): string {
    if (this.#isRelative()) {
      const agoS = Math.round((this.span()[1] - atS) * 10) / 10;
      return agoS < 0.2 ? texts().plots.now : `−${agoS} s`;
    }
    const clockS = atS + this.recorder.offsetS;
    if (this.link.recording !== null) return duration(clockS + 1e-3);
    return clock(1000 * clockS);
  }

  /** Draw all plots; several changes before a picture lead to one. */
  readonly redraw = (): void => {
    this.#asked ||= requestAnimationFrame(() => {
      this.#asked = 0;
      this.#drawnMs = performance.now();
      drawCharts(this.recorder.buffer);
      this.frame.value += 1;
    });
  };

  /** Draw on a beat after a shift by a pixel, and after changes; return a function that ends it. */
  follow(area: HTMLElement, dark: Signal<boolean>): () => void {
    const { endS, layout } = this.recorder;
    const beats = effect(() => {
      void this.link.beat.value;
      const pixelMs = (1000 * layout.peek().windowS) / Math.max(1, area.clientWidth);
      const waitMs = Math.min(SLOWEST_FRAME_MS, pixelMs) - HALF_BEAT_MS;
      const isDue = performance.now() - this.#drawnMs >= waitMs;
      if (endS.peek() === null && isDue) this.redraw();
    });
    const changes = effect(() => {
      void [endS.value, layout.value, dark.value];
      this.redraw();
    });
    const resized = new ResizeObserver(this.redraw);
    resized.observe(area);
    return () => (beats(), changes(), resized.disconnect());
  }

  #isRelative(): boolean {
    return this.recorder.endS.peek() === null && this.link.recording === null;
  }
}

/** Return the handlers of the area around the plots. */
export function gesturesOf(view: PlotView) {
  const pointers = new Map<number, number>(); // Where they are.
  let hasMoved = false;
  const isOnPlot = ({ target }: Event) => (target as Element).closest(".u-over") !== null;
  return {
    onKeyDown: (event: KeyboardEvent) => takeKey(event, view),
    onWheel: (event: WheelEvent) => {
      if (!isOnPlot(event)) return;
      event.preventDefault();
      const across = event.deltaX || (event.shiftKey ? event.deltaY : 0);
      if (across !== 0) view.pan(Math.sign(across) / 10);
      else view.zoom(event.deltaY > 0 ? ZOOM : 1 / ZOOM, shareOf(event));
    },
    onPointerDown: (event: PointerEvent) => {
      if (!isOnPlot(event) || event.button !== 0) return;
      if (pointers.size === 0) hasMoved = false;
      pointers.set(event.pointerId, shareOf(event));
    },
    onPointerMove: (event: PointerEvent) => {
      const before = pointers.get(event.pointerId);
      if (before === undefined) return;
      const at = shareOf(event);
      if (!hasMoved && Math.abs(at - before) < CLICK_SHARE) return;
      hasMoved = true;
      (event.currentTarget as Element).setPointerCapture(event.pointerId);
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      if (other === undefined) view.pan(before - at);
      else if (at !== other) view.zoom(Math.abs((before - other) / (at - other)), (at + other) / 2);
      pointers.set(event.pointerId, at);
    },
    onPointerUp: ({ pointerId }: PointerEvent) => {
      const at = pointers.get(pointerId);
      pointers.delete(pointerId);
      const [fromS, toS] = view.span();
      if (at !== undefined && !hasMoved) view.seek(fromS + at * (toS - fromS));
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
    ArrowLeft: () => moveCursor(-1),
    ArrowRight: () => moveCursor(1),
    End: () => view.end(null),
    Enter: () => atS !== null && view.seek(atS),
  };
  const isOurs = event.target === event.currentTarget && event.key in actions;
  if (!isOurs || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  actions[event.key]!();
}
