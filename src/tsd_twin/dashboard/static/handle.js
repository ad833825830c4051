// A control that is held with one finger, or with the arrow keys while it has the focus.

import { HeldKeys } from "./held.js";

const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

export class Handle {
  /** `place(x, y)` takes shares of `reach(box)` from the centre, right and up; `changed()` follows. */
  constructor(node, { reach, place, changed }) {
    this._node = node;
    this._reach = reach;
    this._place = place;
    this._changed = changed;
    this._pointer = null;
    this._arrows = new HeldKeys();
    node.addEventListener("pointerdown", (event) => this._grab(event));
    node.addEventListener("pointermove", (event) => this._move(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      node.addEventListener(end, (event) => this._drop(event));
    }
    node.addEventListener("blur", () => this._dropArrows());
    node.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  get held() {
    return this._pointer !== null || this._arrows.size > 0;
  }

  /** Spring back; what the finger or the key still does is ignored until it comes down again. */
  cancel() {
    const pointer = this._pointer;
    this._pointer = null;
    this._arrows.cancel();
    this._place(0, 0);
    if (pointer !== null && this._node.hasPointerCapture(pointer))
      this._node.releasePointerCapture(pointer);
  }

  /** Take a key event; return whether it was an arrow key. */
  key(event) {
    if (!(event.code in ARROWS)) return false;
    if (!this._arrows.take(event)) return true;
    this._place(...this._arrows.sum(ARROWS, 2));
    this._changed();
    return true;
  }

  _grab(event) {
    if (this._pointer !== null || event.button !== 0) return;
    event.preventDefault();
    this._node.focus({ preventScroll: true, focusVisible: false });
    this._pointer = event.pointerId;
    this._node.setPointerCapture(event.pointerId);
    this._move(event);
  }

  _move(event) {
    if (event.pointerId !== this._pointer) return;
    const box = this._node.getBoundingClientRect();
    const reach = this._reach(box);
    const x = (event.clientX - box.left - box.width / 2) / reach;
    const y = (box.top + box.height / 2 - event.clientY) / reach;
    this._place(x, y);
    this._changed();
  }

  _drop(event) {
    if (event.pointerId !== this._pointer) return;
    this._pointer = null;
    this._place(0, 0);
    this._changed();
  }

  _dropArrows() {
    if (this._arrows.size === 0) return;
    this._arrows.cancel();
    this._place(0, 0);
    this._changed();
  }
}
