// Runs before viser's client: gives this page its id and leads viser's socket through the gateway.
(() => {
  "use strict";
  const PIXELS = 230_000; // Of the scene, where no graphics card draws them.
  const CHECK_MS = 250;

  const bytes = crypto.getRandomValues(new Uint8Array(8));
  const id = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  // A page that shows a recording has a scene of its own.
  const recording = new URL(location.href).searchParams.get("recording");
  const path = recording === null ? "viser" : `recorded/${encodeURIComponent(recording)}`;
  const socket = new URL(`${path}/${id}`, location.href);
  socket.protocol = location.protocol === "https:" ? "wss:" : "ws:";

  // Which colours the operator likes, and whether a processor has to draw it all: then the scene
  // gets no shadows, and fewer pixels. viser's side learns it with the socket; in one word, since its
  // client writes the address on without escaping it.
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const plain = drawsInSoftware();
  socket.searchParams.set("look", `${dark ? "dark" : "light"}-${plain ? "plain" : "rich"}`);

  // viser's client reads these from the address when it starts, and may write them back later.
  const start = new URL(location.href);
  const given = ["websocket"];
  start.searchParams.set("websocket", socket.href);
  if (plain && !start.searchParams.has("fixedDpr")) {
    given.push("fixedDpr");
    start.searchParams.set("fixedDpr", sharpness().toFixed(2));
  }
  history.replaceState(history.state, "", start);
  setInterval(() => {
    const clean = new URL(location.href);
    if (!given.some((key) => clean.searchParams.has(key))) return;
    if (document.querySelector("canvas[data-engine]") === null) return; // It has not started yet.
    for (const key of given) clean.searchParams.delete(key);
    history.replaceState(history.state, "", clean);
  }, CHECK_MS);

  // viser looks for its server again only while the page has the focus, so a wall display would
  // stay dead after a restart. It asks `hasFocus` and nothing else (WebsocketInterface.tsx), so that
  // is answered for it. Our own controls need to know the truth.
  const hasFocus = document.hasFocus.bind(document);
  document.hasFocus = () => true;

  window.tsd = Object.freeze({ page: id, hasFocus, plain, recording });

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

  /** Pixels of the scene for one of the page, across: so many that a processor draws them in time. */
  function sharpness() {
    return Math.max(0.3, Math.min(1, Math.sqrt(PIXELS / (innerWidth * innerHeight))));
  }
})();
