// The 3D view: viser's page in a frame. On a separate port, the browser gives it a separate process,
// so that a slow scene does not delay the controls. If that port cannot be reached, the frame comes
// from the page's origin.

import { signal } from "@preact/signals";
import type { FrameKey, FromFrame, ToFrame } from "./messages.ts";

const UNREACHED_MS = 5000;
const AFTER_LOAD_MS = 500;
const COMPLETE_FRAMES = 2; // The first may have begun before all of the scene had arrived,
const COMPLETE_MS = 200; // and so may all that a graphics card draws within this time.

interface ViewportOptions {
  /** Page id, 16 hex digits, the same as in the page's socket. */
  page: string;
  recording: string | null;
  dark: boolean;
  /** Accessible name of the frame. */
  title: string;
  /**
   * A key pressed while the frame has the focus, which then returns to the page. For shortcuts such
   * as STOP only: viser's scripts could forge keys, so none of them may drive.
   */
  onKey: (key: FrameKey) => void;
  onPointer: () => void;
  /** Whether the dashboard has sent the whole scene, with the robot in front of the camera. */
  isComplete: () => boolean;
}

/** Return the address of viser's page; `viewport` is empty, a port or an origin. */
export function viewportAddress(base: string, viewport: string): URL {
  const address = new URL("viewport/", base);
  if (/^\d+$/.test(viewport)) address.port = viewport;
  return viewport.includes(":") ? new URL(address.pathname, viewport) : address;
}

export class Viewport {
  /** Whether the frame's script runs. */
  readonly loaded = signal(false);
  /** Whether the browser draws the scene without a graphics card. */
  readonly software = signal(false);
  /** Whether the whole scene has been drawn. */
  readonly ready = signal(false);
  readonly #frame = document.createElement("iframe");
  readonly #ending = new AbortController();
  #origin = "";
  #paused = false;
  #area = 0; // Area of the host in pixels at the chosen sharpness, for software rendering.
  #unreached = 0;
  #drawn = 0; // Frames since the scene is complete.
  #completeMs = 0;
  readonly #resized = new ResizeObserver(() => this.#limitArea());

  /** Show the 3D view in `host`, which must be positioned. */
  constructor(
    private readonly host: HTMLElement,
    private readonly options: ViewportOptions,
  ) {
    const frame = this.#frame;
    frame.className = "viewport-frame";
    frame.title = options.title;
    frame.tabIndex = -1; // Nothing in it can be focused.
    frame.setAttribute("sandbox", "allow-scripts allow-same-origin");
    frame.referrerPolicy = "no-referrer";
    this.setSharpness(1);
    addEventListener("message", (event) => this.#receive(event), { signal: this.#ending.signal });
    // The load event also follows an error page of the browser.
    frame.addEventListener("load", () => this.#fallBackIn(AFTER_LOAD_MS));
    const meta = document.querySelector<HTMLMetaElement>('meta[name="tsd-viewport"]');
    this.#show(meta?.content ?? "");
    host.append(frame);
    this.#resized.observe(host);
  }

  pause(on: boolean): void {
    this.#paused = on;
    const message: ToFrame = { tsd: 1, t: "pause", on };
    if (this.loaded.peek()) this.#frame.contentWindow?.postMessage(message, this.#origin);
  }

  /** Set scene pixels per screen pixel (linear), at most 1; texts in the scene grow by 1 / share. */
  setSharpness(share: number): void {
    const { style } = this.#frame;
    style.width = style.height = `${100 * share}%`;
    style.transform = share === 1 ? "" : `scale(${1 / share})`;
  }

  dispose(): void {
    this.#resized.disconnect();
    clearTimeout(this.#unreached);
    this.#ending.abort();
    this.#frame.remove();
  }

  #show(viewport: string): void {
    const { page, recording, dark } = this.options;
    const address = viewportAddress(document.baseURI, viewport);
    address.searchParams.set("parent", location.origin);
    address.searchParams.set("page", page);
    if (recording !== null) address.searchParams.set("recording", recording);
    address.searchParams.set("look", dark ? "dark" : "light");
    // The frame does not know its size yet, and the fleet hides it at first.
    address.searchParams.set("pixels", String(this.#hostArea || innerWidth * innerHeight));
    this.#origin = address.origin;
    this.#frame.src = address.href;
    this.#fallBackIn(UNREACHED_MS);
  }

  /** Take the frame from the page's origin, unless it is heard before. */
  #fallBackIn(ms: number): void {
    clearTimeout(this.#unreached);
    if (!this.loaded.peek() && this.#origin !== location.origin)
      this.#unreached = window.setTimeout(() => this.#show(""), ms);
  }

  #receive(event: MessageEvent): void {
    if (event.source !== this.#frame.contentWindow || event.origin !== this.#origin) return;
    const message = event.data as FromFrame | undefined;
    if (message?.tsd !== 1) return;
    if (message.t === "loaded") {
      this.loaded.value = true;
      this.software.value = message.software;
      clearTimeout(this.#unreached);
      this.pause(this.#paused);
      this.#area = message.software ? this.#hostArea : 0;
    } else if (message.t === "drawn") this.#onDrawn();
    else if (message.t === "key") this.#onKey(message);
    else if (message.t === "pointerdown") this.options.onPointer();
  }

  #onDrawn(): void {
    if (this.ready.peek() || !this.options.isComplete()) return;
    if (this.#drawn === 0) this.#completeMs = performance.now();
    this.#drawn += 1;
    const sinceMs = performance.now() - this.#completeMs;
    if (this.#drawn < COMPLETE_FRAMES || sinceMs < COMPLETE_MS) return;
    this.ready.value = true;
    this.#frame.dataset["ready"] = "";
  }

  #onKey(key: FrameKey): void {
    if (!key.down || key.repeat || document.activeElement !== this.#frame) return;
    this.#frame.blur();
    this.options.onKey(key);
  }

  /** Keep the number of pixels that the frame chose for software rendering when it grows. */
  #limitArea(): void {
    const area = this.#hostArea;
    if (this.#area > 0 && area > 0) this.setSharpness(Math.min(1, Math.sqrt(this.#area / area)));
  }

  get #hostArea(): number {
    return this.host.clientWidth * this.host.clientHeight;
  }
}
