// Controls that act only while held: keys and pointers, the spring-centred control and the
// hold-to-run button.

/**
 * Set of held keys. When focus returns, some systems report a key held all along as a new press
 * without the repeat flag, and never report one released in between. A key released by the page
 * therefore counts only after its key-up event.
 */
export class KeyState {
  constructor() {
    /** @type {Set<string>} */
    this._down = new Set();
    /** @type {Set<string>} */
    this._ignoredUntilUp = new Set();
  }

  get size() {
    return this._down.size;
  }

  /** @param {Record<string, number[]>} meanings @param {number} length */
  sum(meanings, length) {
    const sum = new Array(length).fill(0);
    for (const code of this._down) meanings[code].forEach((value, i) => (sum[i] += value));
    return sum;
  }

  /** Handle a key event; return whether it changes the held keys. @param {KeyboardEvent} event */
  take({ type, code, repeat }) {
    if (type === "keyup") {
      this._ignoredUntilUp.delete(code);
      return this._down.delete(code);
    }
    if (repeat || this._ignoredUntilUp.has(code) || this._down.has(code)) return false;
    this._down.add(code);
    return true;
  }

  /** Release all keys until their key-up events; return whether any was held. */
  cancel() {
    const wasHeld = this.size > 0;
    for (const code of this._down) this._ignoredUntilUp.add(code);
    this._down.clear();
    return wasHeld;
  }
}

/** @type {("pointerup" | "pointercancel" | "lostpointercapture")[]} */
const POINTER_ENDS = ["pointerup", "pointercancel", "lostpointercapture"];

/** Pointer on a control, from pointerdown until released, cancelled or lost. */
export class PointerCapture {
  /** @param {HTMLElement} node @param {PointerCallbacks} callbacks */
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
    this._onUp(event);
  }
}

const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

/** Spring-centred control, held by a pointer or by arrow keys while focused. */
export class SpringControl {
  /**
   * `changed()` is called on each change; `marginPx` is half of the knob, which stays inside.
   * @param {HTMLElement} node @param {number} marginPx @param {() => void} changed
   */
  constructor(node, marginPx, changed) {
    this._node = node;
    this._marginPx = marginPx;
    this._changed = changed;
    const follow = (/** @type {PointerEvent} */ event) => this._follow(event);
    const gone = () => this._rest();
    this._pointer = new PointerCapture(node, { came: follow, moved: follow, gone });
    this._arrows = new KeyState();
    node.addEventListener("blur", () => this._arrows.cancel() && this._rest());
  }

  /**
   * Set the deflection as fractions of the range; overridden by subclasses.
   * @param {number} _right @param {number} _up
   */
  place(_right, _up) {}

  get held() {
    return this._pointer.down || this._arrows.size > 0;
  }

  /** Centre the control; ignore the pointer or key until it is pressed again. */
  cancel() {
    this._pointer.cancel();
    this._arrows.cancel();
    this.place(0, 0);
  }

  /** Handle a key event; return whether it was an arrow key. @param {KeyboardEvent} event */
  key(event) {
    if (!(event.code in ARROWS)) return false;
    if (!this._arrows.take(event)) return true;
    const [right, up] = this._arrows.sum(ARROWS, 2);
    this.place(right, up);
    this._changed();
    return true;
  }

  /** @param {PointerEvent} event */
  _follow(event) {
    const box = this._node.getBoundingClientRect();
    const reach = box.width / 2 - this._marginPx;
    const x = (event.clientX - box.left - box.width / 2) / reach;
    const y = (box.top + box.height / 2 - event.clientY) / reach;
    this.place(x, y);
    this._changed();
  }

  _rest() {
    this.place(0, 0);
    this._changed();
  }
}

/** Button that is active while a finger or key holds it. */
export class HoldToRunButton {
  /**
   * `code` is the key that holds it regardless of focus; `changed()` is called on each change.
   * @param {HTMLElement} node @param {string} code @param {() => void} changed
   */
  constructor(node, code, changed) {
    this._node = node;
    this._code = code;
    this._changed = changed;
    this._pointer = new PointerCapture(node, { came: () => changed(), gone: () => changed() });
    this._keys = new KeyState();
    node.addEventListener("blur", () => this._keys.cancel() && changed());
    // Key-up may occur after the focus has moved.
    addEventListener("keyup", (event) => this._keys.take(event) && changed(), { capture: true });
  }

  get down() {
    return this._pointer.down || this._keys.size > 0;
  }

  /** Release the button; ignore the pointer or key until it is pressed again. */
  cancel() {
    this._pointer.cancel();
    this._keys.cancel();
  }

  /** Handle a key event; return whether it was for this button. @param {KeyboardEvent} event */
  key(event) {
    const focused =
      /** @type {Document | ShadowRoot} */ (this._node.getRootNode()).activeElement === this._node;
    if (event.code !== this._code && !(event.code === "Enter" && focused)) return false;
    if (this._keys.take(event)) this._changed();
    return true;
  }
}
