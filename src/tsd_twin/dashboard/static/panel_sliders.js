// Sliders in viser's panel. viser reports slider movement but not release, so release is detected
// here: sliders are active while a pointer pressed in the panel is down, or while latched.

const RESET_EVERY_MS = 250;
/** @type {SliderValues} */
const AT_ZERO = { vx: 0, vy: 0, omega: 0, mode: "preview", latch: false };

export class PanelSliders {
  /** @param {Drive} drive @param {Link} link @param {(event: Event) => boolean} isPanel */
  constructor(drive, link, isPanel) {
    this.preview = false; // Sliders pose the gimbals only, and are non-zero.
    this._drive = drive;
    this._link = link;
    this._panel = AT_ZERO;
    /** @type {number | null} */
    this._again = null;
    /** @type {Set<number>} */
    this._pointers = new Set();
    this._touched = false; // Touched since the last release.
    this._resetMs = -Infinity;
    link.on("panel_sliders", (message) => this._take(message));
    link.on(["released", "down"], () => this._show(AT_ZERO));
    addEventListener("pointerdown", (event) => isPanel(event) && this._onPointerDown(event), true);
    addEventListener("keydown", (event) => isPanel(event) && (this._touched = true), true);
    for (const end of /** @type {const} */ (["pointerup", "pointercancel"]))
      addEventListener(end, (event) => this._onPointerUp(event), true);
  }

  get held() {
    return this._panel.mode === "drive" && isMoving(this._panel) && this._isHeld(this._panel);
  }

  /** Whether latched sliders drive the robot without a hand on them. */
  get driveAlone() {
    return this.held && this._pointers.size === 0;
  }

  get twist() {
    const { vx, vy, omega } = this._panel;
    return { vx, vy, omega };
  }

  /** Release: sliders return to zero and stay inactive until touched again. */
  cancel() {
    this._touched = false;
    this._pointers.clear();
    if (this._panel.mode === "drive" && isMoving(this._panel)) this._reset();
  }

  /** @param {SliderValues} panel */
  _isHeld(panel) {
    return this._touched && (panel.latch || this._pointers.size > 0);
  }

  /** @param {PointerEvent} event */
  _onPointerDown(event) {
    this._touched = true;
    this._pointers.add(event.pointerId);
  }

  /** @param {PointerEvent} event */
  _onPointerUp(event) {
    if (!this._pointers.delete(event.pointerId)) return;
    if (this._panel.mode === "drive" && isMoving(this._panel) && !this._isHeld(this._panel))
      this._reset();
    this._drive.changed();
  }

  /** @param {SliderValues} panel */
  _take(panel) {
    this._show(panel);
    // viser may deliver throttled updates after release.
    if (panel.mode === "drive" && isMoving(panel) && !this._isHeld(panel)) this._reset();
    this._drive.changed();
  }

  /** @param {SliderValues} panel */
  _show(panel) {
    this._panel = panel;
    this.preview = panel.mode === "preview" && isMoving(panel);
  }

  _reset() {
    this._show({ ...this._panel, vx: 0, vy: 0, omega: 0 });
    const now = performance.now();
    if (now - this._resetMs < RESET_EVERY_MS) {
      // Repeat after they come to rest, or the last one would keep its value.
      this._again ??= setTimeout(
        () => ((this._again = null), this._requestReset()),
        RESET_EVERY_MS,
      );
      return;
    }
    this._requestReset();
  }

  _requestReset() {
    this._resetMs = performance.now();
    this._link.send({ t: "panel_released" });
  }
}

/** @param {{ vx: number, vy: number, omega: number }} panel */
function isMoving({ vx, vy, omega }) {
  return vx !== 0 || vy !== 0 || omega !== 0;
}
