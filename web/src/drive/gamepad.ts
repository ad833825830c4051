// Gamepad: the left stick drives, the right stick turns, B stops.

import { signal } from "@preact/signals";
import { CENTRED, type Deflection } from "./axes";
import type { Drive, Source } from "./drive";

const PERIOD_MS = 20;
const DEAD_ZONE = 0.1;
const STOP_BUTTON = 1;

export class Gamepad implements Source {
  readonly name = signal<string | null>(null);
  held = false;
  share: Deflection = CENTRED;
  #spent = true; // A new gamepad must be centred first.
  #index: number | null = null;
  #pressed = false;
  #timer: ReturnType<typeof setInterval> | 0 = 0; // Zero without a gamepad.

  constructor(
    private readonly drive: Drive,
    private readonly stop: () => void,
  ) {
    drive.add(this);
    addEventListener("gamepadconnected", () => {
      this.#timer ||= setInterval(() => this.#poll(), PERIOD_MS);
    });
    addEventListener("gamepaddisconnected", ({ gamepad }) => {
      if (gamepad.index === this.#index) this.#use(null); // It may be back before the next poll.
      this.#poll();
    });
  }

  /** Centre the input; ignore the real sticks until they are centred too. */
  cancel(): void {
    this.#spent ||= this.held;
    this.held = false;
    this.share = CENTRED;
  }

  #poll(): void {
    const pad = navigator.getGamepads().find((each) => each?.connected) ?? null;
    if ((pad?.index ?? null) !== this.#index) this.#use(pad);
    if (pad === null) {
      clearInterval(this.#timer);
      this.#timer = 0;
      return;
    }
    const pressed = pad.buttons[STOP_BUTTON]?.pressed ?? false;
    if (pressed && !this.#pressed) this.stop();
    this.#pressed = pressed;
    this.#read(pad.axes);
  }

  /** Handle a removed or changed gamepad: release, then start centred. */
  #use(pad: globalThis.Gamepad | null): void {
    this.#index = pad?.index ?? null;
    this.name.value = pad?.id ?? null;
    const was = this.held;
    this.cancel();
    this.#spent = true;
    this.#pressed = false;
    if (was) this.drive.changed();
  }

  #read([right = 0, down = 0, turn = 0]: readonly number[]): void {
    const [y, x] = withoutDeadZone(-right, -down);
    const [turned] = withoutDeadZone(-turn, 0);
    const centred = x === 0 && y === 0 && turned === 0;
    if (centred) this.#spent = false;
    if (this.#spent || (centred && !this.held)) return;
    this.held = !centred;
    this.share = { x, y, turn: turned };
    this.drive.changed();
  }
}

/** Return the stick position without its round dead zone, so that motion starts at zero. */
function withoutDeadZone(a: number, b: number): [number, number] {
  const length = Math.hypot(a, b);
  if (length < DEAD_ZONE) return [0, 0];
  const share = Math.min(1, (length - DEAD_ZONE) / (1 - DEAD_ZONE)) / length;
  return [a * share, b * share];
}
