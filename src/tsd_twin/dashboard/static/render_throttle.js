// How often viser may draw its scene. Whatever the page shows has to pass through the same graphics
// process as the scene; one whose frames take long would leave no room for a notice, or for what a
// finger does. So no frame is begun before the last one has been drawn, and after one that took long
// the page gets as much time again. Where frames are quick nothing changes. The function is replaced,
// since viser's canvas (react-three-fiber) takes its frames from no other and lets no limit be set.
(() => {
  "use strict";
  const SLOW_MS = 50;
  const LOST_MS = 5000; // No frame takes this long: the fence is lost.

  const next = window.requestAnimationFrame.bind(window);
  /** @type {HTMLCanvasElement | null} */
  let canvas = null;
  /** @type {WebGL2RenderingContext | null} */
  let context = null;
  /** @type {WebGLSync | null} */
  let fence = null; // Passed when the frame has been drawn.
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
      const callback = wanted.get(which); // What they ask for meanwhile is the next frame's.
      if (callback === undefined || !wanted.delete(which)) continue; // One before has cancelled it.
      try {
        callback(timeMs);
      } catch (error) {
        reportError(error); // As the browser does: the others are called all the same.
      }
    }
    if (fence === null) begin();
  }

  function begin() {
    if (!canvas?.isConnected) {
      canvas = document.querySelector("canvas[data-engine]"); // viser's, with its context.
      context = canvas?.getContext("webgl2") ?? null;
    }
    fence = context?.fenceSync(context.SYNC_GPU_COMMANDS_COMPLETE, 0) ?? null;
    context?.flush();
    begunMs = performance.now();
  }
})();
