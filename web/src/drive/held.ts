// What is held: keys and pointers, from their beginning until they are released, cancelled or lost.

import { type Deflection, total } from "./axes";

/** Deflection of each key while it is held. */
export type KeyMeanings = Record<string, Partial<Deflection>>;

/**
 * Set of held keys. When focus returns, some systems report a key held all along as a new press
 * without the repeat flag, and never report one released in between. A key released by the page
 * therefore counts only after its key-up event.
 */
export class HeldKeys {
  #down = new Set<string>();
  #ignoredUntilUp = new Set<string>();

  get size(): number {
    return this.#down.size;
  }

  sum(meanings: KeyMeanings): Deflection {
    return total([...this.#down].map((code) => meanings[code] ?? {}));
  }

  /** Handle a key event; return whether it changes the held keys. */
  take({ type, code, repeat }: Pick<KeyboardEvent, "type" | "code" | "repeat">): boolean {
    if (type === "keyup") {
      this.#ignoredUntilUp.delete(code);
      return this.#down.delete(code);
    }
    if (repeat || this.#ignoredUntilUp.has(code) || this.#down.has(code)) return false;
    this.#down.add(code);
    return true;
  }

  /** Release all keys until their key-up events; return whether any was held. */
  cancel(): boolean {
    const wasHeld = this.size > 0;
    for (const code of this.#down) this.#ignoredUntilUp.add(code);
    this.#down.clear();
    return wasHeld;
  }
}

type PointerCallbacks = Record<"came" | "moved" | "gone", (event: PointerEvent) => void>;

// Browsers delay pointermove until the next frame, up to 0.4 s with a slow scene. They send
// pointerrawupdate to secure pages only.
const MOVES = ["pointerrawupdate", "pointermove"] as const;
const POINTER_ENDS = ["pointerup", "pointercancel", "lostpointercapture"] as const;

/** Pointer on a control, from pointerdown until released, cancelled or lost; `signal` ends it. */
export class HeldPointer {
  #pointer: number | null = null;

  constructor(
    private readonly node: HTMLElement,
    { came, moved, gone }: PointerCallbacks,
    signal?: AbortSignal,
  ) {
    const isOwn = ({ pointerId }: PointerEvent) => pointerId === this.#pointer;
    const grab = (event: PointerEvent) => {
      if (this.down || event.button !== 0) return;
      event.preventDefault();
      node.focus({ preventScroll: true });
      node.setPointerCapture(event.pointerId);
      this.#pointer = event.pointerId;
      came(event);
    };
    const drop = (event: PointerEvent) => {
      if (!isOwn(event)) return;
      this.#pointer = null;
      gone(event);
    };
    node.addEventListener("pointerdown", grab, { signal });
    const move = (event: Event) => isOwn(event as PointerEvent) && moved(event as PointerEvent);
    for (const type of MOVES) node.addEventListener(type, move, { signal });
    for (const end of POINTER_ENDS) node.addEventListener(end, drop, { signal });
    node.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
  }

  get down(): boolean {
    return this.#pointer !== null;
  }

  /** Ignore the pointer until it is pressed again. */
  cancel(): void {
    const pointer = this.#pointer;
    this.#pointer = null;
    if (pointer !== null && this.node.hasPointerCapture(pointer))
      this.node.releasePointerCapture(pointer);
  }
}
