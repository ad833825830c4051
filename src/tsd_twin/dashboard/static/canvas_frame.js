// Places the overlay exactly over the area of viser's 3D canvas, which shrinks when the panel is
// docked. Does not use the canvas itself, which stays a small box in a corner without WebGL.

const CHECK_MS = 250;
const PHONE = "(max-width: 36em)"; // Below this width, viser shows its panel as a drawer.

export class CanvasFrame {
  /** @param {HTMLElement} host */
  constructor(host) {
    this._host = host;
    this._canvas = null;
    /** @type {Element | null} */
    this._drawer = null;
    this._shown = "";
    this._watcher = new ResizeObserver(() => this.fit());
    this.phone = matchMedia(PHONE);
    addEventListener("resize", () => this.fit());
    setInterval(() => this.fit(), CHECK_MS); // Canvas and drawer appear late and may be recreated.
    this.fit();
  }

  /**
   * Whether an event is on viser's panel, that is, neither on the scene nor on our overlay.
   * @param {Event} event
   */
  isPanel(event) {
    const path = event.composedPath();
    return (
      !path.includes(this._host) &&
      !path.includes(/** @type {EventTarget} */ (this._canvas)) &&
      path.includes(document.body)
    );
  }

  /** Whether an event is on the scene itself, below all controls. @param {Event} event */
  isScene(event) {
    const path = event.composedPath();
    return !path.includes(this._host) && this._canvas !== null && path.includes(this._canvas);
  }

  /** Make viser's drawer open above the controls. @param {number} top @param {number} bottom */
  reserve(top, bottom) {
    document.documentElement.style.setProperty("--tsd-top", `${Math.ceil(top)}px`);
    document.documentElement.style.setProperty("--tsd-bottom", `${Math.ceil(bottom)}px`);
  }

  fit() {
    if (!this._canvas?.isConnected) this._adopt(document.querySelector("canvas[data-engine]"));
    if (this._drawer !== null && !this._isDrawer(this._drawer)) {
      this._drawer.removeAttribute("data-tsd-drawer");
      this._drawer = null;
    }
    if (this.phone.matches && this._drawer === null) this._adoptDrawer();
    const box = this._canvas?.parentElement?.getBoundingClientRect();
    const [left, top, width, height] =
      box && box.width > 0
        ? [box.left, box.top, box.width, box.height]
        : [0, 0, innerWidth, innerHeight];
    const shown = `left:${left}px;top:${top}px;width:${width}px;height:${height}px`;
    if (shown !== this._shown) this._host.style.cssText = this._shown = shown;
  }

  /** @param {HTMLCanvasElement | null} canvas */
  _adopt(canvas) {
    this._watcher.disconnect();
    this._canvas = canvas;
    if (canvas?.parentElement) this._watcher.observe(canvas.parentElement);
  }

  /**
   * Whether the node is still viser's drawer; React may reuse the element elsewhere, even around
   * the canvas.
   * @param {Element} node
   */
  _isDrawer(node) {
    if (!this.phone.matches || !node.isConnected || node.contains(this._canvas)) return false;
    return getComputedStyle(node).position === "fixed";
  }

  /** viser's drawer has no id, so find it as the fixed element next to the canvas. */
  _adoptDrawer() {
    /** @type {HTMLElement | null} */
    let node = this._canvas;
    for (; node && node !== document.body; node = node.parentElement) {
      for (const beside of node.parentElement?.children ?? []) {
        if (beside === this._host) continue; // Also fixed at the bottom.
        const style = getComputedStyle(beside);
        if (beside !== node && style.position === "fixed" && style.bottom === "0px") {
          this._drawer = beside;
          beside.setAttribute("data-tsd-drawer", "");
          // It starts open, over the scene; its height is undefined until its contents exist.
          const handle = beside.querySelector('[style*="cursor: pointer"]');
          const contents = handle?.nextElementSibling;
          const isOpen = contents && getComputedStyle(contents).display !== "none";
          // A link to a Student setting refers to the drawer contents.
          const isWanted = new URLSearchParams(location.search).has("student");
          if (isOpen && !isWanted && handle instanceof HTMLElement) handle.click();
          return;
        }
      }
    }
  }
}
