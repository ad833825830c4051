// A control that springs back: stick, slider or button, held by a pointer, or by keys with focus.

import { signal } from "@preact/signals";
import { CENTRED, type Deflection } from "./axes";
import type { Source } from "./drive";
import { HeldKeys, HeldPointer, type KeyMeanings } from "./held";

/** What a control reports to: the command, or a group of controls that are one part of it. */
export interface Holder {
  add(control: SprungControl): () => void;
  changed(): void;
}

export class SprungControl implements Source {
  /** Requested deflection, as fractions of the speed limit. */
  readonly deflection = signal<Deflection>(CENTRED);
  readonly #keys = new HeldKeys();
  #pointer: HeldPointer | null = null;

  constructor(
    private readonly holder: Holder,
    private readonly read: (event: PointerEvent, box: DOMRect) => Deflection,
    private readonly meanings: KeyMeanings,
  ) {}

  get held(): boolean {
    return this.#keys.size > 0 || this.#isTouched;
  }

  get share(): Deflection {
    return this.deflection.peek();
  }

  cancel(): void {
    this.#keys.cancel();
    this.#pointer?.cancel();
    this.deflection.value = CENTRED;
  }

  /** Take pointers and keys of an element, as its `ref`; returns a function that ends it. */
  readonly attach = (node: HTMLElement | null): (() => void) => {
    if (node === null) return () => {};
    const follow = (event: PointerEvent) =>
      this.#place(this.read(event, node.getBoundingClientRect()));
    const ending = new AbortController();
    const { signal } = ending;
    const gone = () => this.#follow();
    this.#pointer = new HeldPointer(node, { came: follow, moved: follow, gone }, signal);
    for (const type of ["keydown", "keyup"] as const)
      node.addEventListener(type, (event) => this.#press(event), { signal });
    // A pointer stays: another finger, on another control, takes the focus.
    const left = () => this.#keys.cancel() && !this.#isTouched && this.#follow();
    node.addEventListener("blur", left, { signal });
    const remove = this.holder.add(this);
    return () => {
      remove();
      this.#pointer = null;
      ending.abort();
    };
  };

  get #isTouched(): boolean {
    return this.#pointer?.down ?? false;
  }

  #place(deflection: Deflection): void {
    this.deflection.value = deflection;
    this.holder.changed();
  }

  #follow(): void {
    this.#place(this.#keys.sum(this.meanings));
  }

  #press(event: KeyboardEvent): void {
    if (event.target !== event.currentTarget) return; // Typed on a control inside.
    const isDown = event.type === "keydown";
    const isHome = event.code === "Home" && isDown;
    if (!isHome && !(event.code in this.meanings)) return;
    // A key-up counts also with a modifier; else the key would stay held.
    if (!isHome && isDown && (event.ctrlKey || event.metaKey || event.altKey)) return;
    event.preventDefault();
    if (isHome) {
      this.cancel();
      this.holder.changed();
    } else if (this.#keys.take(event) && !this.#isTouched) this.#follow();
  }
}
