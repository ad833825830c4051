// A control that is held with one finger, or with the arrow keys while it has the focus.

import { Finger } from "./finger.js";
import { HeldKeys } from "./held.js";

const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

export class Handle {
  /** `place(x, y)` takes shares of `reach(box)` from the centre, right and up; `changed()` follows. */
  constructor(node, { reach, place, changed }) {
    this._node = node;
    this._reach = reach;
    this._place = place;
    this._changed = changed;
    const move = (event) => this._move(event);
    this._finger = new Finger(node, { came: move, moved: move, gone: () => this._rest() });
    this._arrows = new HeldKeys();
    node.addEventListener("blur", () => this._dropArrows());
  }

  get held() {
    return this._finger.down || this._arrows.size > 0;
  }

  /** Spring back; what the finger or the key still does is ignored until it comes down again. */
  cancel() {
    this._finger.cancel();
    this._arrows.cancel();
    this._place(0, 0);
  }

  /** Take a key event; return whether it was an arrow key. */
  key(event) {
    if (!(event.code in ARROWS)) return false;
    if (!this._arrows.take(event)) return true;
    this._place(...this._arrows.sum(ARROWS, 2));
    this._changed();
    return true;
  }

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
