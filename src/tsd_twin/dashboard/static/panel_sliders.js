// The sliders of viser's panel. viser tells when one moves but not when it is let go, so that is
// seen here: they count while a pointer that came down in the panel is down, or while latched.

const RESET_EVERY_MS = 250;
const AT_ZERO = { vx: 0, vy: 0, omega: 0, mode: "preview", latch: false };

export class PanelSliders {
  constructor(drive, link, isPanel) {
    this.preview = false; // They pose the gimbals only, and are not at zero.
    this._drive = drive;
    this._link = link;
    this._panel = AT_ZERO;
    this._pointers = new Set();
    this._touched = false; // By a hand, since they were last let go.
    this._resetMs = -Infinity;
    link.on("panel", (message) => this._take(message));
    for (const gone of ["released", "down"]) link.on(gone, () => this._show(AT_ZERO));
    const listen = (type, listener) => addEventListener(type, listener, { capture: true });
    listen("pointerdown", (event) => isPanel(event) && this._onPointerDown(event));
    listen("keydown", (event) => isPanel(event) && (this._touched = true));
    listen("pointerup", (event) => this._onPointerUp(event));
    listen("pointercancel", (event) => this._onPointerUp(event));
  }

  get held() {
    return this._panel.mode === "drive" && isMoving(this._panel) && this._isHeld(this._panel);
  }

  get twist() {
    const { vx, vy, omega } = this._panel;
    return { vx, vy, omega };
  }

  /** Let go: the sliders spring back, and do nothing until a hand comes to them again. */
  cancel() {
    this._touched = false;
    this._pointers.clear();
    if (this._panel.mode === "drive" && isMoving(this._panel)) this._reset();
  }

  _isHeld(panel) {
    return this._touched && (panel.latch || this._pointers.size > 0);
  }

  _onPointerDown(event) {
    this._touched = true;
    this._pointers.add(event.pointerId);
  }

  _onPointerUp(event) {
    if (!this._pointers.delete(event.pointerId)) return;
    if (this._panel.mode === "drive" && isMoving(this._panel) && !this._isHeld(this._panel))
      this._reset();
    this._drive.changed();
  }

  _take(panel) {
    this._show(panel);
    // What viser has held back for a moment comes after the hand has gone.
    if (panel.mode === "drive" && isMoving(panel) && !this._isHeld(panel)) this._reset();
    this._drive.changed();
  }

  _show(panel) {
    this._panel = panel;
    this.preview = panel.mode === "preview" && isMoving(panel);
  }

  _reset() {
    this._show({ ...this._panel, vx: 0, vy: 0, omega: 0 });
    const now = performance.now();
    if (now - this._resetMs < RESET_EVERY_MS) {
      // Once more when they have come to rest, or the last one would stay where it is.
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

function isMoving({ vx, vy, omega }) {
  return vx !== 0 || vy !== 0 || omega !== 0;
}
