// Patch 1 of viser's client: limits its frame rate by replacing requestAnimationFrame, because its
// canvas (react-three-fiber) has no limit.
//
// The frame has a separate thread, but all frames of a page share one graphics process, so slow
// frames would delay the painting of the page. No frame starts before the last one is drawn, and a
// slow frame is followed by an equally long pause. Fast frames are unaffected.

const SLOW_MS = 50;
const LOST_MS = 5000; // No frame takes this long, so the fence is lost.

/** Three.js marks its canvas; viser's other canvas is a 2D overlay. */
const CANVAS = "canvas[data-engine]";

export class RenderThrottle {
  paused = false;
  readonly #next = window.requestAnimationFrame.bind(window);
  readonly #wanted = new Map<number, FrameRequestCallback>();
  #canvas: HTMLCanvasElement | null = null;
  #context: WebGL2RenderingContext | null = null;
  #fence: WebGLSync | null = null; // Signalled when the frame has been drawn.
  #begunMs = 0;
  #slow = false;
  #restUntilMs = 0;
  #number = 0;
  #asked = false;

  constructor(private readonly onDrawn: () => void) {
    window.requestAnimationFrame = (callback) => {
      this.#wanted.set(++this.#number, callback);
      this.#ask();
      return this.#number;
    };
    window.cancelAnimationFrame = (which) => void this.#wanted.delete(which);
  }

  #ask(): void {
    if (!this.#asked) this.#next((timeMs) => this.#frame(timeMs));
    this.#asked = true;
  }

  #frame(timeMs: number): void {
    this.#asked = false;
    if (this.#mayDraw(performance.now())) this.#draw(timeMs);
    if (this.#wanted.size > 0 || this.#fence !== null) this.#ask();
  }

  #mayDraw(nowMs: number): boolean {
    if (this.#fence !== null && this.#isPassed(nowMs)) {
      const tookMs = nowMs - this.#begunMs;
      this.#slow = tookMs > SLOW_MS;
      this.#restUntilMs = this.#slow ? Math.min(nowMs + tookMs, this.#begunMs + LOST_MS) : 0;
      this.#context?.deleteSync(this.#fence);
      this.#fence = null;
      this.onDrawn();
    }
    const late = this.#fence !== null && (this.#slow || nowMs - this.#begunMs > SLOW_MS);
    return !this.paused && !late && nowMs >= this.#restUntilMs;
  }

  #isPassed(nowMs: number): boolean {
    const context = this.#context;
    return (
      context === null ||
      this.#fence === null ||
      context.isContextLost() ||
      nowMs - this.#begunMs > LOST_MS ||
      context.getSyncParameter(this.#fence, context.SYNC_STATUS) === context.SIGNALED
    );
  }

  #draw(timeMs: number): void {
    for (const which of [...this.#wanted.keys()]) {
      const callback = this.#wanted.get(which); // Requests made during a frame are for the next.
      if (callback === undefined || !this.#wanted.delete(which)) continue; // It was cancelled.
      try {
        callback(timeMs);
      } catch (error) {
        reportError(error); // Like the browser, so that the others still run.
      }
    }
    if (this.#fence === null) this.#begin();
  }

  #begin(): void {
    if (!this.#canvas?.isConnected) {
      this.#canvas = document.querySelector<HTMLCanvasElement>(CANVAS);
      this.#context = this.#canvas?.getContext("webgl2") ?? null;
    }
    const context = this.#context;
    this.#fence = context?.fenceSync(context.SYNC_GPU_COMMANDS_COMPLETE, 0) ?? null;
    context?.flush();
    this.#begunMs = performance.now();
  }
}
