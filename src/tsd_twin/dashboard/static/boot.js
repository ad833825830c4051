// Runs before viser's client: assigns an id to this page and routes viser's socket via the gateway.
(() => {
  "use strict";
  const PIXELS = 230_000; // Scene pixels for software rendering.
  const CHECK_MS = 250;

  const bytes = crypto.getRandomValues(new Uint8Array(8));
  const id = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  // A page that shows a recording has a separate scene.
  const recording = new URL(location.href).searchParams.get("recording");
  const path = recording === null ? "viser" : `recorded/${encodeURIComponent(recording)}`;
  const socket = new URL(`${path}/${id}`, location.href);
  socket.protocol = location.protocol === "https:" ? "wss:" : "ws:";

  // Colour scheme, and whether rendering is in software, in which case the scene has no shadows and
  // fewer pixels. Sent to viser's side in the socket address as one word, because its client does
  // not escape the address.
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const lowDetail = drawsInSoftware();
  socket.searchParams.set("look", `${dark ? "dark" : "light"}-${lowDetail ? "plain" : "rich"}`);

  // viser's client reads these from the address at startup and may write them back later.
  const start = new URL(location.href);
  const given = ["websocket"];
  start.searchParams.set("websocket", socket.href);
  if (lowDetail && !start.searchParams.has("fixedDpr")) {
    given.push("fixedDpr");
    start.searchParams.set("fixedDpr", sharpness().toFixed(2));
  }
  history.replaceState(history.state, "", start);
  setInterval(() => {
    const clean = new URL(location.href);
    if (!given.some((key) => clean.searchParams.has(key))) return;
    if (document.querySelector("canvas[data-engine]") === null) return; // Not started yet.
    for (const key of given) clean.searchParams.delete(key);
    history.replaceState(history.state, "", clean);
  }, CHECK_MS);

  // viser only reconnects while the page has focus, so a wall display would stay disconnected after
  // a restart. It only calls `hasFocus` (WebsocketInterface.tsx), so override that. Our own
  // controls need the real value.
  const hasFocus = document.hasFocus.bind(document);
  document.hasFocus = () => true;

  window.tsd = Object.freeze({ page: id, hasFocus, lowDetail, recording });

  function drawsInSoftware() {
    const context = document.createElement("canvas").getContext("webgl2");
    if (context === null) return true;
    const info = context.getExtension("WEBGL_debug_renderer_info");
    const name = context.getParameter(
      info === null ? context.RENDERER : info.UNMASKED_RENDERER_WEBGL,
    );
    context.getExtension("WEBGL_lose_context")?.loseContext();
    return /swiftshader|llvmpipe|softpipe|software/i.test(name);
  }

  /** Scene pixels per page pixel (linear), limited so that software rendering keeps up. */
  function sharpness() {
    return Math.max(0.3, Math.min(1, Math.sqrt(PIXELS / (innerWidth * innerHeight))));
  }
})();
