// A button that counts while a finger or a key is on it.

import { Finger } from "./finger.js";
import { HeldKeys } from "./held.js";

export class HeldButton {
  /** `code` is the key that holds it wherever the focus is; `changed()` follows each change. */
  constructor(node, code, changed) {
    this._node = node;
    this._code = code;
    this._changed = changed;
    this._finger = new Finger(node, { came: changed, gone: changed });
    this._keys = new HeldKeys();
    node.addEventListener("blur", () => this._dropKeys());
    // A key comes up wherever the focus has gone meanwhile.
    addEventListener("keyup", (event) => this._keys.take(event) && changed(), { capture: true });
  }

  get down() {
    return this._finger.down || this._keys.size > 0;
  }

  /** What the finger or the key still does is ignored until it comes down again. */
  cancel() {
    this._finger.cancel();
    this._keys.cancel();
  }

  /** Take a key event; return whether it was for this button. */
  key(event) {
    const focused = this._node.getRootNode().activeElement === this._node;
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
