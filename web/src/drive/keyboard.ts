// Keys of the whole page, typed here or in the frame. One listener in the capture phase sees them
// before anything else.

import { CENTRED, type Deflection, limited } from "./axes";
import { HeldKeys } from "./held";
import type { Source } from "./drive";

const DRIVE: Record<string, readonly number[]> = {
  KeyW: [1, 0, 0],
  KeyS: [-1, 0, 0],
  KeyA: [0, 1, 0],
  KeyD: [0, -1, 0],
  KeyQ: [0, 0, 1],
  KeyE: [0, 0, -1],
};

/** A key, typed in the page or forwarded from the frame. */
export interface Key {
  readonly type: "keydown" | "keyup";
  readonly code: string;
  readonly key: string;
  readonly repeat: boolean;
  readonly modified: boolean;
}

type Command = (key: Key) => void;

interface Binding {
  readonly pressed: Command;
  /** For a key that is held: called at its key-up, wherever the focus is then. */
  readonly released?: Command;
}

export class Keyboard implements Source {
  readonly #keys = new HeldKeys();
  readonly #commands = new Map<string, Binding>();
  readonly #changed: () => void;
  readonly #stop: () => void;

  constructor(changed: () => void, stop: () => void) {
    this.#changed = changed;
    this.#stop = stop;
    for (const type of ["keydown", "keyup"] as const)
      addEventListener(type, (event) => this.#take(event), { capture: true });
  }

  get held(): boolean {
    return this.#keys.size > 0;
  }

  get share(): Deflection {
    if (!this.held) return CENTRED;
    const [x = 0, y = 0, turn = 0] = this.#keys.sum(DRIVE, 3);
    return limited({ x, y, turn });
  }

  cancel(): void {
    this.#keys.cancel();
  }

  /**
   * Call `pressed` when a key is pressed that nothing with the focus takes, and `released` when it
   * comes up.
   */
  bind(code: string, pressed: Command, released?: Command): () => void {
    const binding = { pressed, released };
    this.#commands.set(code, binding);
    return () => {
      if (this.#commands.get(code) === binding) this.#commands.delete(code);
    };
  }

  /** Take a key of the frame, where nothing has a use for it. Held keys must be typed here. */
  takeForwarded(key: Key): void {
    if (!(key.code in DRIVE) && !this.#commands.get(key.code)?.released) this.#use(key);
  }

  #take(event: KeyboardEvent): void {
    const { type, code, key, repeat } = event;
    const modified = event.ctrlKey || event.metaKey || event.altKey;
    const target = event.composedPath()[0];
    const own = { type: type as Key["type"], code, key, repeat, modified };
    // Wherever the focus is now.
    if (type === "keyup" && this.#keys.take(event)) this.#changed();
    if (type === "keyup") this.#commands.get(code)?.released?.(own);
    if (type === "keydown" && modified) return;
    if (code === "Space" ? takesSpaces(target) : takesText(target)) return;
    if (takeEnter(event, target)) return;
    if (code !== "Space" && takesArrows(event)) return;
    if (!this.#use(own)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  /** Return whether the page has a use for a key. */
  #use(key: Key): boolean {
    const pressed = key.type === "keydown" && !key.repeat && !key.modified;
    if (key.code === "Space") {
      if (pressed) this.#stop();
      return true;
    }
    if (key.code in DRIVE) {
      if (!key.modified && this.#keys.take(key)) this.#changed();
      return true;
    }
    const command = this.#commands.get(key.code) ?? this.#commands.get(key.key);
    if (command === undefined || key.modified) return false;
    if (pressed) command.pressed(key);
    return true;
  }
}

/**
 * Tick a box with Enter, because the space bar stops. Ignore key repeats on buttons, which would
 * press for example Arm and Disarm in turn.
 */
function takeEnter(event: KeyboardEvent, target: EventTarget | undefined): boolean {
  if (event.code !== "Enter" && event.code !== "NumpadEnter") return false;
  const isBox = target instanceof HTMLInputElement && target.type === "checkbox";
  if (isBox && event.type === "keydown" && !event.repeat) target.click();
  const taken = isBox || (event.repeat && target instanceof HTMLButtonElement);
  if (taken) event.preventDefault();
  return true; // Enter belongs to what has the focus.
}

/** Arrow keys and the like belong to a control with the focus that says so. */
function takesArrows({ code, target }: KeyboardEvent): boolean {
  if (!/^(Arrow|Home|End|Page|Escape|Tab)/.test(code)) return false;
  return target instanceof HTMLElement && target !== document.body;
}

const TICKED = new Set(["checkbox", "radio", "range", "button"]);

function takesText(target: EventTarget | undefined): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable) return true;
  if (target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement) return true;
  return target instanceof HTMLInputElement && !target.readOnly && !TICKED.has(target.type);
}

/** The space bar also stops in number fields. */
function takesSpaces(target: EventTarget | undefined): boolean {
  if (!(target instanceof HTMLElement) || !takesText(target)) return false;
  const isNumber = target instanceof HTMLInputElement && target.type === "number";
  return !isNumber && !["numeric", "decimal"].includes(target.inputMode);
}
