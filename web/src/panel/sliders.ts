// The sliders of the panel as one control: they drive, or only look, and may keep their values.

import { computed, signal } from "@preact/signals";
import { CENTRED, type Deflection, total } from "../drive/axes";
import type { Drive, Source } from "../drive/drive";
import type { Holder, SprungControl } from "../drive/sprung";
import type { JointPreview } from "../generated/wire";

/**
 * A released slider returns to zero, or keeps its value until any other input. In mode `looks` it
 * returns as well, and previews joints without moving the robot.
 */
export type SliderMode = "springs" | "keeps" | "looks";

export class PanelSliders implements Source, Holder {
  readonly mode = signal<SliderMode>("springs");
  /** Joints of the twist that is looked at, or null. */
  readonly preview = computed(() => (this.drive.looksOnly.value ? this.#reply.value : null));

  readonly #reply = signal<JointPreview | null>(null);
  readonly #controls = new Set<SprungControl>();
  /** Request of each slider that is held, or keeps its value. */
  readonly #asked = new Map<SprungControl, Deflection>();

  constructor(private readonly drive: Drive) {}

  /** Take part in driving; returns a function that ends it, and with it a kept motion. */
  open(): () => void {
    const { link, looksOnly } = this.drive;
    const ends = [
      this.drive.add(this),
      link.on("robot", () => this.zero()),
      link.on("preview", (reply) => {
        if (looksOnly.peek() && reply.robot === link.robot.peek()?.id) this.#reply.value = reply;
      }),
    ];
    return () => ends.forEach((end) => end());
  }

  get held(): boolean {
    return this.#asked.size > 0;
  }

  get alone(): boolean {
    return this.#asked.size > 0 && ![...this.#controls].some(({ held }) => held);
  }

  get looksOnly(): boolean {
    return this.mode.peek() === "looks";
  }

  get share(): Deflection {
    return total([...this.#asked.values()]);
  }

  add(control: SprungControl): () => void {
    this.#controls.add(control);
    return () => {
      control.cancel();
      this.#asked.delete(control);
      this.#controls.delete(control);
      this.changed();
    };
  }

  changed(): void {
    for (const control of this.#controls) {
      const { x, y, turn } = this.#asked.get(control) ?? CENTRED;
      const keeps = this.mode.peek() === "keeps" && (x !== 0 || y !== 0 || turn !== 0);
      if (control.held) this.#asked.set(control, control.share);
      else if (!keeps) this.#asked.delete(control);
    }
    this.drive.changed();
    if (!this.drive.looksOnly.peek()) this.#reply.value = null;
  }

  cancel(): void {
    for (const control of this.#controls) control.cancel();
    if (this.mode.peek() === "keeps" && this.#asked.size > 0) this.mode.value = "springs";
    this.#asked.clear();
  }

  /** Centre all sliders: the robot stops. */
  zero(): void {
    this.cancel();
    this.changed();
  }

  choose(mode: SliderMode): void {
    this.zero();
    this.mode.value = mode;
  }
}
