// Which keys are held. Where the focus has been away, a key that was held all the while comes as if
// it were pressed anew, on some systems without the mark of a repeat; and one that was lifted
// meanwhile never says so. So a key that was released by the page counts only after its key-up event.

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

  /**
   * Return the sum of what the keys that are held mean: lists of `length` numbers.
   * @param {Record<string, number[]>} meanings
   * @param {number} length
   */
  sum(meanings, length) {
    const sum = new Array(length).fill(0);
    for (const code of this._down) meanings[code].forEach((value, i) => (sum[i] += value));
    return sum;
  }

  /**
   * Take a key going down or up; return whether that changes what is held.
   * @param {KeyboardEvent} event
   */
  take({ type, code, repeat }) {
    if (type === "keyup") {
      this._ignoredUntilUp.delete(code);
      return this._down.delete(code);
    }
    if (repeat || this._ignoredUntilUp.has(code) || this._down.has(code)) return false;
    this._down.add(code);
    return true;
  }

  cancel() {
    for (const code of this._down) this._ignoredUntilUp.add(code);
    this._down.clear();
  }
}
