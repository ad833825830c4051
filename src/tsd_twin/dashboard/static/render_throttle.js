// Limits viser's frame rate. The page and the scene share one graphics process, so slow frames
// would delay notices and input. No frame starts before the last one is drawn, and a slow frame is
// followed by an equally long pause for the page. Fast frames are unaffected. Replaces
// requestAnimationFrame, because viser's canvas (react-three-fiber) has no frame-rate limit.
(() => {
  "use strict";
  const SLOW_MS = 50;
  const LOST_MS = 5000; // No frame takes this long, so the fence is lost.

  const next = window.requestAnimationFrame.bind(window);
  /** @type {HTMLCanvasElement | null} */
  let canvas = null;
  /** @type {WebGL2RenderingContext | null} */
  let context = null;
  /** @type {WebGLSync | null} */
  let fence = null; // Signalled when the frame has been drawn.
  let begunMs = 0;
  let slow = false;
  let restUntilMs = 0;
  let number = 0;
  /** @type {Map<number, FrameRequestCallback>} */
  const wanted = new Map();
  let asked = false;

  window.requestAnimationFrame = (callback) => {
    wanted.set(++number, callback);
    ask();
    return number;
  };
  window.cancelAnimationFrame = (which) => void wanted.delete(which);

  function ask() {
    if (!asked) next(frame);
    asked = true;
  }

  /** @param {number} timeMs */
  function frame(timeMs) {
    asked = false;
    if (mayDraw(performance.now())) draw(timeMs);
    if (wanted.size > 0 || fence !== null) ask();
  }

  /** @param {number} nowMs */
  function mayDraw(nowMs) {
    if (fence !== null && isPassed(nowMs)) {
      const tookMs = nowMs - begunMs;
      slow = tookMs > SLOW_MS;
      restUntilMs = slow ? Math.min(nowMs + tookMs, begunMs + LOST_MS) : 0;
      context?.deleteSync(fence);
      fence = null;
    }
    const late = fence !== null && (slow || nowMs - begunMs > SLOW_MS);
    return !late && nowMs >= restUntilMs;
  }

  /** @param {number} nowMs */
  function isPassed(nowMs) {
    return (
      context === null ||
      fence === null ||
      context.isContextLost() ||
      nowMs - begunMs > LOST_MS ||
      context.getSyncParameter(fence, context.SYNC_STATUS) === context.SIGNALED
    );
  }

  /** @param {number} timeMs */
  function draw(timeMs) {
    for (const which of [...wanted.keys()]) {
      const callback = wanted.get(which); // Requests made during a frame belong to the next one.
      if (callback === undefined || !wanted.delete(which)) continue; // It was cancelled.
      try {
        callback(timeMs);
      } catch (error) {
        reportError(error); // Like the browser, so that the others still run.
      }
    }
    if (fence === null) begin();
  }

  function begin() {
    if (!canvas?.isConnected) {
      canvas = document.querySelector("canvas[data-engine]"); // viser's canvas, with its context.
      context = canvas?.getContext("webgl2") ?? null;
    }
    fence = context?.fenceSync(context.SYNC_GPU_COMMANDS_COMPLETE, 0) ?? null;
    context?.flush();
    begunMs = performance.now();
  }
})();
