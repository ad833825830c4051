// Pointer capture: one pointer on a control, from pointerdown until it is released, cancelled or lost.

/** @type {("pointerup" | "pointercancel" | "lostpointercapture")[]} */
const POINTER_ENDS = ["pointerup", "pointercancel", "lostpointercapture"];

export class PointerCapture {
  /**
   * `came(event)` and `moved(event)` follow it; `gone()` comes when it has left by itself.
   * @param {HTMLElement} node
   * @param {{
   *   came: (event: PointerEvent) => void,
   *   moved?: (event: PointerEvent) => void,
   *   gone: () => void,
   * }} callbacks
   */
  constructor(node, { came, moved = () => {}, gone }) {
    this._node = node;
    this._onDown = came;
    this._onUp = gone;
    /** @type {number | null} */
    this._pointer = null;
    node.addEventListener("pointerdown", (event) => this._grab(event));
    node.addEventListener("pointermove", (event) => this._is(event) && moved(event));
    for (const end of POINTER_ENDS) node.addEventListener(end, (event) => this._drop(event));
    node.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  get down() {
    return this._pointer !== null;
  }

  /** Ignore the pointer until it is pressed again. */
  cancel() {
    const pointer = this._pointer;
    this._pointer = null;
    if (pointer !== null && this._node.hasPointerCapture(pointer))
      this._node.releasePointerCapture(pointer);
  }

  /** @param {PointerEvent} event */
  _is(event) {
    return event.pointerId === this._pointer;
  }

  /** @param {PointerEvent} event */
  _grab(event) {
    if (this.down || event.button !== 0) return;
    event.preventDefault();
    this._node.focus({ preventScroll: true, focusVisible: false });
    this._node.setPointerCapture(event.pointerId);
    this._pointer = event.pointerId;
    this._onDown(event);
  }

  /** @param {PointerEvent} event */
  _drop(event) {
    if (!this._is(event)) return;
    this._pointer = null;
    this._onUp();
  }
}
