// A control that springs back: stick or slider, held by a pointer or by arrow keys with the focus.

import { signal } from "@preact/signals";
import { CENTRED, type Deflection } from "./axes";
import type { Source } from "./drive";
import { HeldKeys, HeldPointer } from "./held";

/** Deflection of a pointer, from its place in the box of the control. */
export type Reading = (event: PointerEvent, box: DOMRect) => Deflection;
/** Deflection of each arrow key, as ahead, left and turning left. */
export type Arrows = Record<string, readonly [number, number, number]>;

/** What a control reports to: the command, or a group of controls that are one part of it. */
export interface Holder {
  add(control: SprungControl): () => void;
  changed(): void;
}

export class SprungControl implements Source {
  /** What the hand asks for, as shares of the speed limit. */
  readonly deflection = signal<Deflection>(CENTRED);
  readonly #drive: Holder;
  readonly #read: Reading;
  readonly #arrows: Arrows;
  readonly #keys = new HeldKeys();
  #pointer: HeldPointer | null = null;

  constructor(drive: Holder, read: Reading, arrows: Arrows) {
    this.#drive = drive;
    this.#read = read;
    this.#arrows = arrows;
  }

  get held(): boolean {
    return this.#keys.size > 0 || (this.#pointer?.down ?? false);
  }

  get share(): Deflection {
    return this.deflection.peek();
  }

  cancel(): void {
    this.#keys.cancel();
    this.#pointer?.cancel();
    this.deflection.value = CENTRED;
  }

  /** Take pointers and keys of an element and drive with them; returns a function that ends it. */
  attach(node: HTMLElement): () => void {
    const follow = (event: PointerEvent) =>
      this.#place(this.#read(event, node.getBoundingClientRect()));
    this.#pointer = new HeldPointer(node, {
      came: follow,
      moved: follow,
      gone: () => this.#place(this.#ofKeys()),
    });
    const pressed = (event: KeyboardEvent) => this.#press(event);
    // A pointer stays: another finger, on another control, takes the focus.
    const left = () => this.#keys.cancel() && !this.#pointer?.down && this.#place(CENTRED);
    node.addEventListener("keydown", pressed);
    node.addEventListener("keyup", pressed);
    node.addEventListener("blur", left);
    const remove = this.#drive.add(this);
    return () => {
      remove();
      this.#pointer?.end();
      this.#pointer = null;
      node.removeEventListener("keydown", pressed);
      node.removeEventListener("keyup", pressed);
      node.removeEventListener("blur", left);
    };
  }

  #place(deflection: Deflection): void {
    this.deflection.value = deflection;
    this.#drive.changed();
  }

  #press(event: KeyboardEvent): void {
    if (event.target !== event.currentTarget) return; // Typed on a control inside.
    if (event.code === "Home" && event.type === "keydown") {
      event.preventDefault();
      this.cancel();
      this.#drive.changed();
      return;
    }
    if (!(event.code in this.#arrows)) return;
    // A key-up counts also with a modifier; else the key would stay held.
    if (event.type === "keydown" && (event.ctrlKey || event.metaKey || event.altKey)) return;
    event.preventDefault();
    if (this.#keys.take(event) && !(this.#pointer?.down ?? false)) this.#place(this.#ofKeys());
  }

  #ofKeys(): Deflection {
    const [x = 0, y = 0, turn = 0] = this.#keys.sum(this.#arrows, 3);
    return { x, y, turn };
  }
}
