// Plots in a separate window. It shows the data recorded by the page that opened it, and has no
// server connection, so it cannot drive. The space bar is STOP here too, sent by that page.

import { el, setText } from "./dom.js";
import { Plots } from "./plots.js";

const CHECK_MS = 500;
const STYLES = ["base", "panel", "buttons", "vendor/uPlot.min", "plots"];

const root = /** @type {HTMLElement} */ (document.querySelector("[data-plots]")).attachShadow({
  mode: "open",
});
const note = el("p", { role: "status" });
const place = el("div");
root.append(
  ...STYLES.map((name) => el("link", { rel: "stylesheet", href: `${name}.css` })),
  note,
  place,
);
/** @type {Recorder | null} */
let shown = null;
let controller = new AbortController();

addEventListener(
  "keydown",
  (event) => {
    if (event.code !== "Space" || event.composedPath()[0] instanceof HTMLInputElement) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) source()?.stop();
  },
  { capture: true },
);
setInterval(check, CHECK_MS);
check();

/** Page that opened this window, if it still exists. */
function source() {
  /** @type {Window | null} */
  const opener = window.opener;
  return opener === null || opener.closed ? null : (opener.tsdPlots ?? null);
}

/** A reloaded page has a new recorder. */
function check() {
  const now = source();
  const scheme = now === null ? "" : now.scheme();
  document.documentElement.style.colorScheme = scheme;
  setText(note, now === null ? "The page that opened this window is closed or loads." : "");
  note.hidden = now !== null;
  if (now === null || now.recorder === shown) return;
  shown = now.recorder;
  controller.abort();
  controller = new AbortController();
  place.replaceChildren();
  new Plots(shown, place, controller.signal);
}
