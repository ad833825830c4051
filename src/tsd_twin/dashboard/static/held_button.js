// A button that counts while a finger or a key is on it.

import { HeldKeys } from "./held.js";

export class HeldButton {
  /** `code` is the key that holds it wherever the focus is; `changed()` follows each change. */
  constructor(node, code, changed) {
    this._node = node;
    this._code = code;
    this._changed = changed;
    this._pointer = null;
    this._keys = new HeldKeys();
    node.addEventListener("pointerdown", (event) => this._grab(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"])
      node.addEventListener(end, (event) => this._drop(event));
    node.addEventListener("blur", () => this._dropKeys());
    node.addEventListener("contextmenu", (event) => event.preventDefault());
    // A key comes up wherever the focus has gone meanwhile.
    addEventListener("keyup", (event) => this._keys.take(event) && changed(), { capture: true });
  }

  get down() {
    return this._pointer !== null || this._keys.size > 0;
  }

  /** What the finger or the key still does is ignored until it comes down again. */
  cancel() {
    const pointer = this._pointer;
    this._pointer = null;
    this._keys.cancel();
    if (pointer !== null && this._node.hasPointerCapture(pointer))
      this._node.releasePointerCapture(pointer);
  }

  /** Take a key event; return whether it was for this button. */
  key(event) {
    const focused = this._node.getRootNode().activeElement === this._node;
    if (event.code !== this._code && !(event.code === "Enter" && focused)) return false;
    if (this._keys.take(event)) this._changed();
    return true;
  }

  _grab(event) {
    if (this._pointer !== null || event.button !== 0) return;
    event.preventDefault();
    this._node.focus({ preventScroll: true, focusVisible: false });
    this._node.setPointerCapture(event.pointerId);
    this._pointer = event.pointerId;
    this._changed();
  }

  _drop(event) {
    if (event.pointerId !== this._pointer) return;
    this._pointer = null;
    this._changed();
  }

  _dropKeys() {
    if (this._keys.size === 0) return;
    this._keys.cancel();
    this._changed();
  }
}
