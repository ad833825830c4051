// Runs before viser's client in the frame. It sets the client's address, keeps keys from its camera
// and forwards them to the page, and hides everything but the scene.

import type { FromFrame, ToFrame } from "../src/viewport/messages.ts";
import { setParameters } from "./address.ts";
import { RenderThrottle } from "./throttle.ts";

const TICK_MS = 50;

// The server has checked it: no other page can frame this one.
const pageOrigin = new URL(location.href).searchParams.get("parent") ?? location.origin;

// viser reconnects only while the page has the focus, which the dashboard's page usually has.
document.hasFocus = () => true;
const software = setParameters(new URL(location.href));

// Hide viser's panel, notices and logo: whatever neither is the scene nor contains it. The page's
// background shows through until the scene is drawn, and while it is resized.
const style = document.createElement("style");
style.textContent = `
  body :not(canvas, :has(canvas)) { display: none !important }
  html, body, :has(canvas) { background: transparent !important; color-scheme: light !important }
`;
document.head.append(style);

const throttle = new RenderThrottle(() => send({ tsd: 1, t: "drawn" }));

addEventListener("message", (event) => {
  if (event.source !== parent || event.origin !== pageOrigin) return;
  const message = event.data as ToFrame | undefined;
  if (message?.tsd === 1 && message.t === "pause") throttle.paused = message.on;
});

// On the window before all others, so that no key moves viser's camera.
for (const type of ["keydown", "keyup"] as const) addEventListener(type, forwardKey, true);
addEventListener("keypress", (event) => event.stopImmediatePropagation(), true);
addEventListener("pointerdown", () => send({ tsd: 1, t: "pointerdown" }), true);
// The page keeps the focus, so that its keys still work after a click on the scene.
addEventListener("mousedown", (event) => event.preventDefault(), true);

// Report by how much this thread is late, when it is.
let lastMs = performance.now();
setInterval(() => {
  const nowMs = performance.now();
  const lateMs = nowMs - lastMs - TICK_MS;
  lastMs = nowMs;
  if (lateMs > TICK_MS) send({ tsd: 1, t: "stalled", ms: Math.round(lateMs) });
}, TICK_MS);
send({ tsd: 1, t: "loaded", software });

function send(message: FromFrame): void {
  if (parent !== window) parent.postMessage(message, pageOrigin);
}

function forwardKey(event: KeyboardEvent): void {
  event.stopImmediatePropagation();
  const { code, key, repeat, ctrlKey: ctrl, altKey: alt, shiftKey: shift, metaKey: meta } = event;
  // The browser keeps its shortcuts, function keys and Tab.
  if (!ctrl && !alt && !meta && !/^(Tab|F\d+)$/.test(key)) event.preventDefault();
  if (event.isComposing) return;
  const mods = { ctrl, alt, shift, meta };
  send({ tsd: 1, t: "key", code, key, down: event.type === "keydown", repeat, mods });
}
