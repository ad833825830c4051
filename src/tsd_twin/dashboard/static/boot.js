// Runs before viser's client: gives this page its id and leads viser's socket through the gateway.
(() => {
  "use strict";
  const bytes = crypto.getRandomValues(new Uint8Array(8));
  const id = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  const socket = new URL(`viser/${id}`, location.href);
  socket.protocol = location.protocol === "https:" ? "wss:" : "ws:";

  // viser's client reads these from the address, once, when it starts; nobody else needs them.
  const ours = { websocket: socket.href };
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  if (dark && !new URLSearchParams(location.search).has("darkMode")) ours.darkMode = "";

  const replaceState = history.replaceState.bind(history);
  const start = new URL(location.href);
  for (const [key, value] of Object.entries(ours)) start.searchParams.set(key, value);
  replaceState(history.state, "", start);
  history.replaceState = (state, title, address) => {
    const clean = new URL(address ?? location.href, location.href);
    for (const key of Object.keys(ours)) clean.searchParams.delete(key);
    replaceState(state, title, clean);
  };

  // viser looks for its server again only while the page has the focus, so a wall display would
  // stay dead after a restart. Our own controls need to know the truth.
  const hasFocus = document.hasFocus.bind(document);
  document.hasFocus = () => true;

  window.tsd = Object.freeze({ page: id, hasFocus });
})();
