// Whether the browser draws on a graphics card. Without one, blurring what is behind our surfaces
// takes more than half of the frames.

export function drawsInSoftware() {
  const context = document.createElement("canvas").getContext("webgl2");
  if (context === null) return true;
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = context.getParameter(
    info === null ? context.RENDERER : info.UNMASKED_RENDERER_WEBGL,
  );
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software/i.test(name);
}
