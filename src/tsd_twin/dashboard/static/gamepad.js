// Gamepad: left stick drives, right stick turns, B stops.

const PERIOD_MS = 20;
const DEAD_ZONE = 0.1;
const STOP_BUTTON = 1;

export class Gamepad {
  /** @param {Drive} drive @param {() => void} stop */
  constructor(drive, stop) {
    this.unit = { x: 0, y: 0, turn: 0 };
    this.held = false;
    this._drive = drive;
    this._stop = stop;
    this._spent = true; // A new gamepad must be centred first.
    this._index = null; // Index of the gamepad in use.
    this._pressed = false;
    this._timer = 0; // Zero without a gamepad.
    addEventListener("gamepadconnected", () => this._watch());
    addEventListener("gamepaddisconnected", ({ gamepad }) => {
      if (gamepad.index === this._index) this._change(null); // It may be back before the next poll.
      this._poll();
    });
  }

  /** Centre the input; ignore the real sticks until they are centred too. */
  cancel() {
    this._spent = this._spent || this.held;
    this.held = false;
    this.unit = { x: 0, y: 0, turn: 0 };
  }

  _watch() {
    this._timer ||= setInterval(() => this._poll(), PERIOD_MS);
  }

  _poll() {
    const pad = navigator.getGamepads().find((each) => each?.connected) ?? null;
    if (pad === null) {
      clearInterval(this._timer);
      this._timer = 0;
    }
    if ((pad?.index ?? null) !== this._index) this._change(pad?.index ?? null);
    const pressed = pad?.buttons[STOP_BUTTON]?.pressed ?? false;
    if (pressed && !this._pressed) this._stop();
    this._pressed = pressed;
    if (pad !== null) this._read(pad.axes);
  }

  /**
   * Handle a removed or changed gamepad: release, then start centred.
   * @param {number | null} index
   */
  _change(index) {
    this._index = index;
    const was = this.held;
    this.cancel();
    this._spent = true;
    this._pressed = false;
    if (was) this._drive.changed();
  }

  /** @param {readonly number[]} axes */
  _read([right = 0, down = 0, turn = 0]) {
    const [y, x] = stick(-right, -down);
    const turned = beyond(-turn);
    const centred = x === 0 && y === 0 && turned === 0;
    if (centred) this._spent = false;
    if (this._spent || (centred && !this.held)) return;
    this.held = !centred;
    this.unit = { x, y, turn: turned };
    this._drive.changed();
  }
}

/**
 * Return the stick position without its round dead zone, so that motion starts at zero.
 * @param {number} a @param {number} b
 */
function stick(a, b) {
  const length = Math.hypot(a, b);
  const share =
    length < DEAD_ZONE ? 0 : Math.min(1, (length - DEAD_ZONE) / (1 - DEAD_ZONE)) / length;
  return [a * share, b * share];
}

/** @param {number} value */
function beyond(value) {
  return stick(value, 0)[0];
}
