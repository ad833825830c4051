// Controls that act only while they are held, by pointer or by key: spring-centred control and button.

import { KeyState } from "./key_state.js";
import { PointerCapture } from "./pointer_capture.js";

// Spring-centred control, held with one pointer, or with the arrow keys while it has the focus.
const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

export class SpringControl {
  /**
   * `place(x, y)` takes shares of `reach(box)` from the centre, right and up; `changed()` follows.
   * @param {HTMLElement} node
   * @param {{
   *   reach: (box: DOMRect) => number,
   *   place: (right: number, up: number) => void,
   *   changed: () => void,
   * }} callbacks
   */
  constructor(node, { reach, place, changed }) {
    this._node = node;
    this._reach = reach;
    this._place = place;
    this._changed = changed;
    const move = (/** @type {PointerEvent} */ event) => this._move(event);
    this._pointerCapture = new PointerCapture(node, {
      came: move,
      moved: move,
      gone: () => this._rest(),
    });
    this._arrows = new KeyState();
    node.addEventListener("blur", () => this._dropArrows());
  }

  get held() {
    return this._pointerCapture.down || this._arrows.size > 0;
  }

  /** Centre the control; the pointer or key is ignored until it is pressed again. */
  cancel() {
    this._pointerCapture.cancel();
    this._arrows.cancel();
    this._place(0, 0);
  }

  /**
   * Take a key event; return whether it was an arrow key.
   * @param {KeyboardEvent} event
   */
  key(event) {
    if (!(event.code in ARROWS)) return false;
    if (!this._arrows.take(event)) return true;
    const [right, up] = this._arrows.sum(ARROWS, 2);
    this._place(right, up);
    this._changed();
    return true;
  }

  /** @param {PointerEvent} event */
  _move(event) {
    const box = this._node.getBoundingClientRect();
    const reach = this._reach(box);
    const x = (event.clientX - box.left - box.width / 2) / reach;
    const y = (box.top + box.height / 2 - event.clientY) / reach;
    this._place(x, y);
    this._changed();
  }

  _rest() {
    this._place(0, 0);
    this._changed();
  }

  _dropArrows() {
    if (this._arrows.size === 0) return;
    this._arrows.cancel();
    this._rest();
  }
}

// A button that counts while a finger or a key is on it.
export class HoldToRunButton {
  /**
   * `code` is the key that holds it wherever the focus is; `changed()` follows each change.
   * @param {HTMLElement} node
   * @param {string} code
   * @param {() => void} changed
   */
  constructor(node, code, changed) {
    this._node = node;
    this._code = code;
    this._changed = changed;
    this._pointerCapture = new PointerCapture(node, { came: () => changed(), gone: changed });
    this._keys = new KeyState();
    node.addEventListener("blur", () => this._dropKeys());
    // A key comes up wherever the focus has gone meanwhile.
    addEventListener("keyup", (event) => this._keys.take(event) && changed(), { capture: true });
  }

  get down() {
    return this._pointerCapture.down || this._keys.size > 0;
  }

  /** Release the button; the pointer or key is ignored until it is pressed again. */
  cancel() {
    this._pointerCapture.cancel();
    this._keys.cancel();
  }

  /**
   * Take a key event; return whether it was for this button.
   * @param {KeyboardEvent} event
   */
  key(event) {
    const focused =
      /** @type {Document | ShadowRoot} */ (this._node.getRootNode()).activeElement === this._node;
    if (event.code !== this._code && !(event.code === "Enter" && focused)) return false;
    if (this._keys.take(event)) this._changed();
    return true;
  }

  _dropKeys() {
    if (this._keys.size === 0) return;
    this._keys.cancel();
    this._changed();
  }
}
