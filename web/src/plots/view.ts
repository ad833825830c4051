// The time axis that all plots share: window, pause, cursor and, in a recording, seeking.

import { signal } from "@preact/signals";
import type { Link } from "../store/link";
import { language, texts } from "../text/text";
import { duration } from "../text/numbers";
import { limitedWindow } from "./layout";
import type { Recorder } from "./recorder";

export class PlotView {
  /** Right edge in robot time while paused, else null: now. */
  readonly endS = signal<number | null>(null);
  /** Robot time under the cursor. */
  readonly cursorS = signal<number | null>(null);
  readonly recorder: Recorder;
  readonly #link: Link;

  constructor(recorder: Recorder, link: Link) {
    this.recorder = recorder;
    this.#link = link;
  }

  /** Robot time at both edges. */
  span(): [number, number] {
    const endS = this.endS.peek() ?? this.recorder.nowS();
    return [endS - this.recorder.layout.peek().windowS, endS];
  }

  /** Index of the sample whose values are shown: at the cursor, or the last one. */
  index(): number {
    const { buffer } = this.recorder;
    const [, toS] = this.span();
    return buffer.places(-Infinity, this.cursorS.value ?? toS)[1] - 1;
  }

  pause(paused: boolean): void {
    this.#end(paused ? this.span()[1] : null);
  }

  setWindow(seconds: number): void {
    const { layout } = this.recorder;
    this.recorder.choose({ ...layout.peek(), windowS: limitedWindow(seconds) });
  }

  /** Zoom about a position, 0 at the left edge; unless paused, the right edge stays at now. */
  zoom(factor: number, at: number): void {
    const [fromS, toS] = this.span();
    this.setWindow((toS - fromS) * factor);
    if (this.endS.peek() === null) return;
    const { windowS } = this.recorder.layout.peek();
    this.#end(fromS + at * (toS - fromS) + (1 - at) * windowS);
  }

  /** Move by a fraction of the window. */
  pan(share: number): void {
    this.#end(this.span()[1] + share * this.recorder.layout.peek().windowS);
  }

  /** In a recording, show the moment of a robot time; the plots then end there. */
  seek(robotS: number): void {
    if (this.#link.recording === null || Number.isNaN(this.recorder.offsetS)) return;
    this.endS.value = null;
    this.#link.send({ t: "seek", t_s: Math.max(0, robotS + this.recorder.offsetS) });
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
    const { recorder } = this;
    if (this.#isRelative()) {
      const agoS = Math.round((this.span()[1] - atS) * 10) / 10;
      return agoS < 0.2 ? texts().plots.now : `−${agoS} s`;
    }
    if (this.#link.recording !== null) return duration(atS + recorder.offsetS + 1e-3);
    const time = new Date(1000 * (atS + recorder.offsetS));
    return time.toLocaleTimeString(language.value, { timeStyle: "medium" });
  }

  #isRelative(): boolean {
    return this.endS.peek() === null && this.#link.recording === null;
  }

  #end(endS: number | null): void {
    const oldestS = this.recorder.buffer.times[0];
    const isLive = endS === null || oldestS === undefined;
    const latest = this.recorder.nowS();
    this.endS.value = isLive ? null : Math.max(oldestS, Math.min(latest, endS));
  }
}
