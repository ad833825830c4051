// The sliders of viser's panel. viser tells when one moves but not when it is let go, so that is
// seen here: they count while a pointer that came down in the panel is down, or while latched.

const RESET_EVERY_MS = 250;

export class Sliders {
  constructor(drive, link, isPanel) {
    this.preview = false; // They pose the gimbals only, and are not at zero.
    this._drive = drive;
    this._link = link;
    this._panel = null;
    this._pointers = new Set();
    this._spent = false;
    this._resetMs = -Infinity;
    link.on("panel", (message) => this._take(message));
    link.on("beat", () => this._reset());
    link.on("down", () => this._take({ vx: 0, vy: 0, omega: 0, mode: "preview", latch: false }));
    addEventListener("pointerdown", (event) => isPanel(event) && this._pointers.add(event.pointerId), { capture: true });
    for (const end of ["pointerup", "pointercancel"]) {
      addEventListener(end, (event) => this._drop(event), { capture: true });
    }
  }

  get held() {
    const panel = this._panel;
    if (panel?.mode !== "drive" || this._spent || !isMoving(panel)) return false;
    return panel.latch || this._pointers.size > 0;
  }

  get twist() {
    const { vx, vy, omega } = this._panel ?? { vx: 0, vy: 0, omega: 0 };
    return { vx, vy, omega };
  }

  /** Let go: until the sliders have sprung back, they do nothing. */
  cancel() {
    if (this._panel?.mode !== "drive" || !isMoving(this._panel)) return;
    this._spent = true;
    this._reset();
  }

  _take(panel) {
    this._panel = panel;
    this.preview = panel.mode === "preview" && isMoving(panel);
    if (!isMoving(panel)) this._spent = false;
    this._drive.changed();
    this._reset();
  }

  _drop(event) {
    if (!this._pointers.delete(event.pointerId)) return;
    this._drive.changed();
    this._reset();
  }

  /** Ask for the sliders to spring back; again if need be, since a late message may move them. */
  _reset() {
    const panel = this._panel;
    const now = performance.now();
    if (panel?.mode !== "drive" || !isMoving(panel) || this.held || now - this._resetMs < RESET_EVERY_MS) return;
    this._resetMs = now;
    this._link.send({ t: "panel_released" });
  }
}

function isMoving({ vx, vy, omega }) {
  return vx !== 0 || vy !== 0 || omega !== 0;
}
