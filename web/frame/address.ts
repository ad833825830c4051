// Sets the parameters that viser's client reads from its address at startup.

const SOFTWARE_PIXELS = 230_000; // Scene pixels for software rendering.
const LEAST_DPR = 0.3;

/**
 * Route viser's socket through the gateway, and set its colours and sharpness; return whether it
 * draws in software.
 */
export function setParameters(address: URL): boolean {
  const given = address.searchParams;
  const recording = given.get("recording") ?? "";
  const path = recording === "" ? "viser" : `recorded/${encodeURIComponent(recording)}`;
  const socket = new URL(`../${path}/${given.get("page") ?? ""}`, address);
  socket.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  // Software rendering gets a scene without shadows and with fewer pixels. One word, because
  // viser's client does not escape the address.
  const colours = given.get("look") === "light" ? "light" : "dark";
  const inSoftware = drawsInSoftware();
  socket.searchParams.set("look", `${colours}-${inSoftware ? "plain" : "rich"}-frame`);
  given.set("websocket", socket.href);
  if (colours === "dark") given.set("darkMode", "");
  if (inSoftware) given.set("fixedDpr", softwareDpr(Number(given.get("pixels"))).toFixed(2));
  history.replaceState(history.state, "", address);
  return inSoftware;
}

function drawsInSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  if (context === null) return true;
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = context.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER) as string;
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software/i.test(name);
}

/** Scene pixels per page pixel (linear), limited so that software rendering keeps up. */
function softwareDpr(pagePixels: number): number {
  return Math.max(LEAST_DPR, Math.min(1, Math.sqrt(SOFTWARE_PIXELS / Math.max(1, pagePixels))));
}
