// Keys of the whole page, typed here or in the frame. One listener in the capture phase sees them
// before anything else.

import { type Deflection, limited } from "./axes";
import type { Drive, Source } from "./drive";
import { HeldKeys, type KeyMeanings } from "./held";

const DRIVE: KeyMeanings = {
  KeyW: { x: 1 },
  KeyS: { x: -1 },
  KeyA: { y: 1 },
  KeyD: { y: -1 },
  KeyQ: { turn: 1 },
  KeyE: { turn: -1 },
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

export class Keyboard implements Source {
  readonly #keys = new HeldKeys();
  readonly #commands = new Map<string, { pressed: Command; released?: Command }>();

  constructor(
    private readonly drive: Drive,
    private readonly stop: () => void,
  ) {
    drive.add(this);
    for (const type of ["keydown", "keyup"] as const)
      addEventListener(type, (event) => this.#take(event), { capture: true });
  }

  get held(): boolean {
    return this.#keys.size > 0;
  }

  get share(): Deflection {
    return limited(this.#keys.sum(DRIVE));
  }

  cancel(): void {
    this.#keys.cancel();
  }

  /**
   * Call the command of a key when it is pressed and nothing with the focus takes it, and `released`,
   * for a key that is held, when it comes up, wherever the focus is then.
   */
  bind(keys: Record<string, Command>, released?: Command): () => void {
    const bound = Object.entries(keys);
    for (const [code, pressed] of bound) this.#commands.set(code, { pressed, released });
    return () => {
      for (const [code, pressed] of bound)
        if (this.#commands.get(code)?.pressed === pressed) this.#commands.delete(code);
    };
  }

  /** Take a key of the frame, where nothing has a use for it. Held keys must be typed here. */
  takeForwarded(key: Key): void {
    if (!(key.code in DRIVE) && !this.#commands.get(key.code)?.released) this.#use(key);
  }

  #take(event: KeyboardEvent): void {
    const { type, code, key, repeat, target } = event;
    const modified = event.ctrlKey || event.metaKey || event.altKey;
    const own = { type: type as Key["type"], code, key, repeat, modified };
    if (type === "keyup") {
      // Wherever the focus is now.
      if (this.#keys.take(event)) this.drive.changed();
      this.#commands.get(code)?.released?.(own);
    } else if (modified) return;
    if (target instanceof HTMLElement && belongsTo(target, event)) return;
    if (!this.#use(own)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  /** Return whether the page has a use for a key. */
  #use(key: Key): boolean {
    const pressed = key.type === "keydown" && !key.repeat && !key.modified;
    if (key.code === "Space") {
      if (pressed) this.stop();
      return true;
    }
    if (key.code in DRIVE) {
      if (!key.modified && this.#keys.take(key)) this.drive.changed();
      return true;
    }
    const command = this.#commands.get(key.code) ?? this.#commands.get(key.key);
    if (command === undefined || key.modified) return false;
    if (pressed) command.pressed(key);
    return true;
  }
}

const TICKED = ["checkbox", "radio", "range", "button"].map((type) => `[type=${type}]`).join();
const TEXT = `textarea, select, [contenteditable], input:not(${TICKED}):not([readonly])`;
const NUMBER = "[type=number], [inputmode=numeric], [inputmode=decimal]";

/** Whether a key belongs to the control that has the focus. */
function belongsTo(target: HTMLElement, event: KeyboardEvent): boolean {
  const { code } = event;
  // The space bar also stops in number fields.
  if (code === "Space") return target.matches(TEXT) && !target.matches(NUMBER);
  if (target.matches(TEXT)) return true;
  if (code === "Enter" || code === "NumpadEnter") return takeEnter(event, target);
  return /^(Arrow|Home|End|Page|Escape|Tab)/.test(code) && target !== document.body;
}

/**
 * Tick a box with Enter, because the space bar stops. Ignore key repeats on buttons, which would
 * press for example Arm and Disarm in turn.
 */
function takeEnter(event: KeyboardEvent, target: HTMLElement): true {
  const isBox = target.matches("[type=checkbox]");
  if (isBox && event.type === "keydown" && !event.repeat) target.click();
  if (isBox || (event.repeat && target.matches("button"))) event.preventDefault();
  return true;
}
