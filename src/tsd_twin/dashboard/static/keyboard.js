// Keyboard: W A S D and Q E drive, the space bar stops, Enter ticks boxes. Listeners run before
// viser's, which move the camera with the same keys.

import { KeyState } from "./held_controls.js";

const DRIVE = {
  KeyW: [1, 0, 0],
  KeyS: [-1, 0, 0],
  KeyA: [0, 1, 0],
  KeyD: [0, -1, 0],
  KeyQ: [0, 0, 1],
  KeyE: [0, 0, -1],
};

export class Keyboard {
  /**
   * `focused(event)` may handle a key for the focused control, and returns whether it did.
   * `stop(isOnBox)` receives whether the space bar was pressed on a check box.
   * @param {Drive} drive
   * @param {{ focused: (event: KeyboardEvent) => boolean, stop: (isOnBox: boolean) => void }} callbacks
   */
  constructor(drive, { focused, stop }) {
    this._drive = drive;
    this._focused = focused;
    this._stop = stop;
    this._keys = new KeyState();
    addEventListener("keydown", (event) => this._take(event), { capture: true });
    addEventListener("keyup", (event) => this._take(event), { capture: true });
  }

  get held() {
    return this._keys.size > 0;
  }

  get unit() {
    const [x, y, turn] = this._keys.sum(DRIVE, 3);
    const length = Math.max(1, Math.hypot(x, y));
    return { x: x / length, y: y / length, turn };
  }

  cancel() {
    this._keys.cancel();
  }

  /** @param {KeyboardEvent} event */
  _take(event) {
    const target = event.composedPath()[0];
    const up = event.type === "keyup";
    // Key-up may occur after the focus has moved, and with other keys held.
    if (up && this._keys.take(event)) this._drive.changed();
    if (!up && (event.ctrlKey || event.metaKey || event.altKey)) return;
    if (event.code === "Space" ? takesSpaces(target) : takesText(target)) return;
    const taken =
      this._focused(event) ||
      this._takeStop(event, target) ||
      takeEnter(event, target) ||
      this._takeDrive(event);
    if (!taken) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  /** @param {KeyboardEvent} event @param {EventTarget | undefined} target */
  _takeStop(event, target) {
    if (event.code !== "Space") return false;
    if (event.type === "keydown" && !event.repeat) this._stop(isCheckbox(target));
    return true;
  }

  /** @param {KeyboardEvent} event */
  _takeDrive(event) {
    if (!(event.code in DRIVE)) return false;
    if (this._keys.take(event)) this._drive.changed();
    return true;
  }
}

/**
 * Tick a box with Enter, because the space bar stops. Ignore key repeats on buttons, which would
 * press for example Arm and Disarm in turn.
 * @param {KeyboardEvent} event @param {EventTarget | undefined} target
 */
function takeEnter({ type, code, repeat }, target) {
  if (code !== "Enter" && code !== "NumpadEnter") return false;
  if (isCheckbox(target)) {
    if (type === "keydown" && !repeat) /** @type {HTMLInputElement} */ (target).click();
    return true;
  }
  return repeat && target instanceof HTMLButtonElement;
}

/** @param {EventTarget | undefined} target */
function isCheckbox(target) {
  return target instanceof HTMLInputElement && target.type === "checkbox";
}

/** @param {EventTarget | undefined} target */
function takesText(target) {
  if (!(target instanceof HTMLElement)) return false;
  if (
    target.isContentEditable ||
    target instanceof HTMLTextAreaElement ||
    target instanceof HTMLSelectElement
  )
    return true;
  return (
    target instanceof HTMLInputElement &&
    !target.readOnly &&
    !["checkbox", "radio", "range", "button"].includes(target.type)
  );
}

/** The space bar also stops in number fields. @param {EventTarget | undefined} target */
function takesSpaces(target) {
  if (!(target instanceof HTMLElement)) return false;
  const numeric =
    ["numeric", "decimal"].includes(target.inputMode) ||
    (target instanceof HTMLInputElement && target.type === "number");
  return takesText(target) && !numeric;
}
