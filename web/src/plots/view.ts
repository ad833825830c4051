// The time axis that all plots share: window, pause, cursor, seeking; and when they are drawn.

import { computed, effect, type Signal, signal } from "@preact/signals";
import { freshness, isCurrent } from "../store/freshness";
import type { Link } from "../store/link";
import { duration } from "../text/numbers";
import { language, texts } from "../text/text";
import type { PlotChart } from "./chart";
import { limitedWindow } from "./layout";
import type { Recorder } from "./recorder";

const SLOWEST_FRAME_MS = 500;

export class PlotView {
  /** Robot time under the cursor. */
  readonly cursorS = signal<number | null>(null);
  /** Name of the field that is dragged. */
  readonly dragged = signal<string | null>(null);
  /** Counts drawn pictures: the values beside them follow it. */
  readonly frame = signal(0);
  readonly isStale = computed(() => this.link.beat.value >= 0 && !isCurrent(freshness(this.link)));
  readonly charts = new Set<PlotChart>();
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

  /** Pause with this right edge within what is recorded, or go on. */
  end(endS: number | null): void {
    const [oldestS] = this.recorder.buffer.times;
    const isLive = endS === null || oldestS === undefined;
    const latestS = this.recorder.nowS();
    this.recorder.endS.value = isLive ? null : Math.max(oldestS, Math.min(latestS, endS));
  }

  setWindow(seconds: number): void {
    const { layout } = this.recorder;
    this.recorder.choose({ ...layout.peek(), windowS: limitedWindow(seconds) });
  }

  /** Zoom about a position, 0 at the left edge; unless paused, the right edge stays at now. */
  zoom(factor: number, at: number): void {
    const [fromS, toS] = this.span();
    this.setWindow((toS - fromS) * factor);
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
    return new Date(1000 * clockS).toLocaleTimeString(language.value, { timeStyle: "medium" });
  }

  /** Draw all plots; several changes before a picture lead to one. */
  readonly redraw = (): void => {
    this.#asked ||= requestAnimationFrame(() => {
      this.#asked = 0;
      this.#drawnMs = performance.now();
      for (const chart of this.charts) chart.draw();
      this.frame.value += 1;
    });
  };

  /**
   * Draw on beats after a shift by a pixel, and after changes of the view or its
   * size. Return a function that ends it.
   */
  follow(area: HTMLElement, dark: Signal<boolean>): () => void {
    const { endS, layout } = this.recorder;
    const ends = [
      effect(() => {
        void this.link.beat.value;
        const pixelMs = (1000 * layout.peek().windowS) / Math.max(1, area.clientWidth);
        const isDue = performance.now() - this.#drawnMs >= Math.min(SLOWEST_FRAME_MS, pixelMs);
        if (endS.peek() === null && isDue) this.redraw();
      }),
      effect(() => {
        void [endS.value, layout.value, dark.value];
        this.redraw();
      }),
    ];
    const resized = new ResizeObserver(this.redraw);
    resized.observe(area);
    return () => {
      resized.disconnect();
      for (const end of ends) end();
    };
  }

  #isRelative(): boolean {
    return this.recorder.endS.peek() === null && this.link.recording === null;
  }
}
