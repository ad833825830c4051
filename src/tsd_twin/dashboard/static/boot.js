// Runs before viser's client: gives this page its id and leads viser's socket through the gateway.
(() => {
  "use strict";
  const bytes = crypto.getRandomValues(new Uint8Array(8));
  const id = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  const socket = new URL(`viser/${id}`, location.href);
  socket.protocol = location.protocol === "https:" ? "wss:" : "ws:";

  // Which colours the operator likes; viser's side learns it with the socket.
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  socket.searchParams.set("dark", dark ? "1" : "0");

  // viser's client reads this from the address, once, when it starts; nobody else needs it.
  const KEY = "websocket";
  const replaceState = history.replaceState.bind(history);
  const start = new URL(location.href);
  start.searchParams.set(KEY, socket.href);
  replaceState(history.state, "", start);
  history.replaceState = (state, title, address) => {
    const clean = new URL(address ?? location.href, location.href);
    clean.searchParams.delete(KEY);
    replaceState(state, title, clean);
  };

  // viser looks for its server again only while the page has the focus, so a wall display would
  // stay dead after a restart. Our own controls need to know the truth.
  const hasFocus = document.hasFocus.bind(document);
  document.hasFocus = () => true;

  window.tsd = Object.freeze({ page: id, hasFocus });
})();
