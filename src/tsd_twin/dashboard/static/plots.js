// Plots tab: selected fields on a shared time axis, with zoom, pan, pause, cursor and export.

import { el, isVisible, setAttribute, setText } from "./dom.js";
import { fixed } from "./format.js";
import { PlotChart, tick } from "./plot_chart.js";
import { PlotChooser } from "./plot_chooser.js";

const LIBRARY = new URL("vendor/uPlot.iife.min.js", import.meta.url).href;
const WINDOW = new URL("plots_window.html", import.meta.url).href;
const TICK_MS = 80;
const SLOWEST_TICK_MS = 500;
const WINDOWS = { "20 s": 20, "1 min": 60, "2 min": 120, "5 min": 300, "10 min": 600 };
const ZOOM = 1.25;
const LINE_PX = 18; // Two above each plot in an image.
const HELP =
  "Arrow keys move the cursor, plus and minus zoom, page up and page down pan, P pauses, End goes on.";
const NAME = { "aria-label": "Plots", "aria-description": HELP };

export class Plots {
  /** @param {Recorder} recorder @param {ParentNode} place @param {AbortSignal} signal */
  constructor(recorder, place, signal) {
    this._recorder = recorder;
    /** @type {PlotChart[]} */
    this._charts = [];
    this._shown = ""; // Selection for which the charts were built.
    /** @type {number | null} */
    this._endS = null; // Right edge in robot time while paused, else null (now).
    /** @type {number | null} */
    this._cursor = null; // Cursor position in the buffer.
    this._generation = 0; // Buffer generation.
    this._oldestS = NaN; // Oldest time in the buffer; when it changes, indices shift.
    this._drawnMs = -Infinity;
    /** @type {Map<number, number>} */
    this._pointers = new Map(); // Position of each pointer, relative to the width.
    const button = (/** @type {string} */ text, /** @type {() => void} */ onclick) =>
      el("button.button", { type: "button", onclick }, text);
    /** @type {HTMLSelectElement} */
    this._window = el(
      "select",
      { "aria-label": "Time window", onchange: () => this._setWindow(Number(this._window.value)) },
      el("option", { hidden: true, value: "" }),
      ...Object.entries(WINDOWS).map(([text, value]) => el("option", { value }, text)),
    );
    this._pause = button("Pause", () => this._setEnd(this._endS === null ? this.span()[1] : null));
    this._time = el("span.value.time", { role: "timer", "aria-label": "Time" });
    this._paper = el("i.paper", { hidden: true });
    this._area = el("div.charts", { role: "group", tabindex: 0, ...NAME });
    const chooser = new PlotChooser(recorder, () => this._redraw());
    const files = [button("CSV", () => this._exportCsv()), button("PNG", () => this._exportPng())];
    // Only in the recording page, which has one such window.
    if (window.tsdPlots !== undefined) files.push(button("Window", openWindow));
    const key = [el("span.thin"), "set-point", el("span.thick"), "measured"];
    this._place = el(
      "div.plots",
      el("div.tools", this._window, this._pause, chooser.button, ...files),
      chooser.element,
      el("p.key", ...key, this._time, this._paper),
      this._area,
    );
    place.append(this._place);
    this._listen();
    const timer = setInterval(() => this._draw(), TICK_MS);
    signal.addEventListener("abort", () => {
      clearInterval(timer);
      for (const { plot } of this._charts) plot.destroy();
    });
  }

  // View, as queried by the charts.

  /** @returns {[number, number]} Robot time at both edges. */
  span() {
    const endS = this._endS ?? this._recorder.nowS();
    return [endS - this._recorder.windowS, endS];
  }

  /**
   * Lines of the time axis: relative to now, or at round robot times.
   * @param {number} fromS @param {number} toS @param {number} stepS
   */
  splits(fromS, toS, stepS) {
    const lastS = this._endS === null ? toS : Math.floor(toS / stepS) * stepS;
    const count = Math.floor((lastS - fromS) / stepS) + 1;
    return Array.from({ length: count }, (_, i) => lastS - (count - 1 - i) * stepS);
  }

  /** @param {number} atS */
  timeText(atS) {
    if (this._endS !== null) return `${tick(atS)} s`;
    const ago = Math.round((this.span()[1] - atS) * 10) / 10;
    return ago < 0.2 ? "now" : `\u2212${ago} s`;
  }

  /** @param {number | null} at */
  onCursor(at) {
    this._cursor = at;
    this._showValues();
  }

  /** @param {number | null} endS */
  _setEnd(endS) {
    const oldestS = this._recorder.buffer.times[0] ?? NaN;
    const isLive = endS === null || Number.isNaN(oldestS);
    this._endS = isLive ? null : Math.max(oldestS, Math.min(this._recorder.nowS(), endS));
    this._redraw();
  }

  /** @param {number} seconds */
  _setWindow(seconds) {
    this._recorder.windowS = seconds;
    this._redraw();
  }

  /**
   * Zoom about a position, 0 at the left edge; unless paused, the right edge stays at now.
   * @param {number} factor @param {number} at
   */
  _zoom(factor, at) {
    const [fromS, toS] = this.span();
    this._setWindow((toS - fromS) * factor);
    if (this._endS === null) return;
    this._setEnd(fromS + at * (toS - fromS) + (1 - at) * this._recorder.windowS);
  }

  /** @param {number} share Fraction of the window. */
  _pan(share) {
    this._setEnd(this.span()[1] + share * this._recorder.windowS);
  }

  // User input.

  _listen() {
    const area = this._area;
    area.addEventListener("wheel", (event) => this._onWheel(event), { passive: false });
    area.addEventListener("pointerdown", (event) => {
      if (isOnPlot(event) && event.button === 0)
        this._pointers.set(event.pointerId, this._share(event));
    });
    area.addEventListener("pointermove", (event) => this._onMove(event));
    for (const type of /** @type {const} */ (["pointerup", "pointercancel"]))
      area.addEventListener(type, ({ pointerId }) => this._pointers.delete(pointerId));
    area.addEventListener("dblclick", () => this._setEnd(null));
    area.addEventListener("keydown", (event) => this._onKey(event));
  }

  /** @param {MouseEvent} event */
  _share({ clientX }) {
    const { left, width } = this._charts[0].plot.over.getBoundingClientRect();
    return (clientX - left) / width;
  }

  /** @param {WheelEvent} event */
  _onWheel(event) {
    if (!isOnPlot(event)) return;
    event.preventDefault();
    const across = event.deltaX || (event.shiftKey ? event.deltaY : 0);
    if (across !== 0) this._pan(Math.sign(across) / 10);
    else this._zoom(event.deltaY > 0 ? ZOOM : 1 / ZOOM, this._share(event));
  }

  /** One pointer pans, two zoom. @param {PointerEvent} event */
  _onMove(event) {
    const before = this._pointers.get(event.pointerId);
    if (before === undefined) return;
    const at = this._share(event);
    if (at === before) return;
    this._area.setPointerCapture(event.pointerId);
    this._pointers.set(event.pointerId, at);
    const [other] = [...this._pointers].filter(([id]) => id !== event.pointerId);
    if (other === undefined) this._pan(before - at);
    else if (at !== other[1])
      this._zoom(Math.abs((before - other[1]) / (at - other[1])), (at + other[1]) / 2);
  }

  /** @param {KeyboardEvent} event */
  _onKey(event) {
    /** @type {Record<string, () => void>} */
    const actions = {
      "+": () => this._zoom(1 / ZOOM, 0.5),
      "-": () => this._zoom(ZOOM, 0.5),
      PageUp: () => this._pan(-0.5),
      PageDown: () => this._pan(0.5),
      ArrowLeft: () => this._moveCursor(-1),
      ArrowRight: () => this._moveCursor(1),
      End: () => this._setEnd(null),
      p: () => this._pause.click(),
    };
    if (!(event.key in actions) || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation(); // viser's camera uses the same keys.
    actions[event.key]();
  }

  /** Move the cursor of all charts, by default from the middle. @param {number} pixels */
  _moveCursor(pixels) {
    const plot = this._charts[0]?.plot;
    if (plot === undefined) return;
    const { left = -1 } = plot.cursor;
    const { width } = plot.over.getBoundingClientRect();
    const to = left < 0 ? width / 2 : Math.max(0, Math.min(width - 1, left + pixels));
    for (const chart of this._charts) chart.plot.setCursor({ left: to, top: 0 });
  }

  // Drawing: only while visible, and only after a shift by a pixel.

  _redraw() {
    this._drawnMs = -Infinity;
    this._draw();
  }

  _draw() {
    const { buffer, fields, robot, windowS } = this._recorder;
    if (buffer.length === 0 || !isVisible(this._place)) return;
    if (window.uPlot === undefined) {
      loadLibrary();
      return;
    }
    if (this._generation !== buffer.generation) this._endS = null; // Different clock.
    this._generation = buffer.generation;
    const shown = [robot?.id, ...fields.map(({ name }) => name)].join();
    if (shown !== this._shown) this._build(window.uPlot, fields);
    this._shown = shown;
    this._showValues();
    const { clientWidth: width } = this._area;
    const isOther =
      this._oldestS !== buffer.times[0] || this._charts.some(({ plot }) => plot.width !== width);
    this._oldestS = buffer.times[0];
    const waitMs = Math.min(SLOWEST_TICK_MS, (1000 * windowS) / width) - TICK_MS / 2;
    const nowMs = performance.now();
    if (!isOther && nowMs - this._drawnMs < (this._endS === null ? waitMs : Infinity)) return;
    this._drawnMs = nowMs;
    setText(this._pause, this._endS === null ? "Pause" : "Go on");
    setAttribute(this._area, "data-paused", this._endS === null ? null : "");
    this._window.value = Object.values(WINDOWS).includes(windowS) ? String(windowS) : "";
    for (const chart of this._charts) chart.draw();
  }

  /** @param {typeof import("uplot")} Library @param {PlotField[]} fields */
  _build(Library, fields) {
    for (const { plot } of this._charts) plot.destroy();
    const groups = [...Map.groupBy(fields, ({ title, unit }) => `${title} ${unit}`).values()];
    this._charts = groups.map((group, i) => {
      const isLast = i === groups.length - 1;
      return new PlotChart(Library, this._recorder.buffer, group, this, isLast);
    });
    this._area.replaceChildren(...this._charts.map(({ element }) => element));
    this._drawnMs = -Infinity;
  }

  _showValues() {
    const { buffer } = this._recorder;
    const [, end] = buffer.places(...this.span());
    const at = this._cursor ?? end - 1;
    setText(this._time, `${fixed(buffer.times[at], 2)} s`);
    for (const chart of this._charts) chart.show(at);
  }

  // Export of the visible range.

  _exportCsv() {
    const text = this._recorder.buffer.csv(this._recorder.fields, ...this.span());
    this._save(new Blob([text], { type: "text/csv" }), "csv");
  }

  _exportPng() {
    const canvas = el("canvas");
    const pen = canvas.getContext("2d");
    if (pen === null || this._charts.length === 0) return;
    const density = devicePixelRatio;
    const line = LINE_PX * density;
    const pictures = this._charts.map(({ plot }) => plot.ctx.canvas);
    canvas.width = pictures[0].width;
    canvas.height = pictures.reduce((sum, { height }) => sum + 2 * line + height, 0);
    pen.fillStyle = getComputedStyle(this._paper).backgroundColor;
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.font = `${12 * density}px system-ui, sans-serif`;
    let top = 0;
    this._charts.forEach(({ element, legend }, i) => {
      for (const nodes of [element.querySelectorAll("strong, .unit"), legend]) {
        let left = 4 * density;
        for (const node of nodes) {
          pen.fillStyle = getComputedStyle(node).color;
          pen.fillText(node.textContent, left, top + 0.8 * line);
          left += pen.measureText(node.textContent).width + 8 * density;
        }
        top += line;
      }
      pen.drawImage(pictures[i], 0, top);
      top += pictures[i].height;
    });
    canvas.toBlob((blob) => blob && this._save(blob, "png"));
  }

  /** @param {Blob} blob @param {string} ending */
  _save(blob, ending) {
    const href = URL.createObjectURL(blob);
    const seconds = Math.round(this.span()[1]);
    el("a", { href, download: `${this._recorder.robot?.id}-${seconds}s.${ending}` }).click();
    setTimeout(() => URL.revokeObjectURL(href), 10_000);
  }
}

/** @param {Event} event */
function isOnPlot({ target }) {
  return target instanceof Element && target.closest(".u-over") !== null;
}

function openWindow() {
  open(WINDOW, "tsd-plots", "popup,width=900,height=700")?.focus();
}

let isLoading = false;

/** Load uPlot when the tab is first shown. */
function loadLibrary() {
  if (isLoading) return;
  isLoading = true;
  document.head.append(el("script", { src: LIBRARY, onerror: () => (isLoading = false) }));
}
