// The 3D view: viser's page in a frame. On a separate port, the browser gives it a separate process,
// so that a slow scene does not delay the controls. If that port cannot be reached, the frame comes
// from the page's origin.

import { signal } from "@preact/signals";
import type { ReadonlySignal } from "@preact/signals";
import type { FrameKey, FromFrame, ToFrame } from "./messages.ts";
import "./viewport.css";

export type { FrameKey };

const UNREACHED_MS = 5000;
const AFTER_LOAD_MS = 500;
const WATCH_MS = 250;
const SILENT_MS = 750; // The frame reports four times a second.

export interface ViewportOptions {
  /** Page id, 16 hex digits, the same as in the page's socket. */
  page: string;
  /** File name of a recording to show, or null. */
  recording: string | null;
  dark: boolean;
  /** Accessible name of the frame. */
  title: string;
  /**
   * A key pressed while the frame has the focus, which then returns to the page. For shortcuts such
   * as STOP only: viser's scripts could forge keys, so none of them may drive.
   */
  onKey?: (key: FrameKey) => void;
  onPointer?: (pointer: string) => void;
}

export interface Viewport {
  /** Whether the frame's script runs. */
  loaded: ReadonlySignal<boolean>;
  /** Whether the first frame has been drawn. */
  ready: ReadonlySignal<boolean>;
  /** How long the frame's thread was blocked in the last second, or has been silent, in ms. */
  stalledMs: ReadonlySignal<number>;
  /** Whether the frame has the page's origin and therefore its thread. */
  shared: ReadonlySignal<boolean>;
  /** Stop drawing, or resume. */
  pause(on: boolean): void;
  /** Set scene pixels per screen pixel (linear), at most 1; texts in the scene grow by 1 / share. */
  setSharpness(share: number): void;
  dispose(): void;
}

/** Return the address of viser's page; `viewport` is empty, a port or an origin. */
export function viewportAddress(base: string, viewport: string): URL {
  const address = new URL("viewport/", base);
  if (/^\d+$/.test(viewport)) address.port = viewport;
  else if (viewport !== "") {
    const origin = new URL(viewport);
    address.protocol = origin.protocol;
    address.hostname = origin.hostname;
    address.port = origin.port;
  }
  return address;
}

/** Show the 3D view in `host`, which must be positioned. */
export function createViewport(host: HTMLElement, options: ViewportOptions): Viewport {
  return new FrameViewport(host, options);
}

class FrameViewport implements Viewport {
  readonly loaded = signal(false);
  readonly ready = signal(false);
  readonly stalledMs = signal(0);
  readonly shared = signal(false);
  readonly #options: ViewportOptions;
  readonly #frame = document.createElement("iframe");
  readonly #watch: number;
  #origin = "";
  #paused = false;
  #area = 0; // Of the frame in pixels when its sharpness was chosen, for software rendering.
  #heardMs = 0;
  #unreached = 0;
  readonly #resized = new ResizeObserver(() => this.#limitArea());

  constructor(host: HTMLElement, options: ViewportOptions) {
    this.#options = options;
    const frame = this.#frame;
    frame.className = "viewport-frame";
    frame.title = options.title;
    frame.tabIndex = -1; // Nothing in it can be focused.
    frame.setAttribute("sandbox", "allow-scripts allow-same-origin");
    frame.referrerPolicy = "no-referrer";
    this.setSharpness(1);
    addEventListener("message", this.#receive);
    frame.addEventListener("load", this.#onLoad);
    this.#watch = window.setInterval(() => this.#checkSilence(), WATCH_MS);
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

  setSharpness(share: number): void {
    const { style } = this.#frame;
    style.width = style.height = `${100 * share}%`;
    style.transform = share === 1 ? "" : `scale(${1 / share})`;
  }

  /** Keep the number of pixels that the frame chose for software rendering when it grows. */
  readonly #limitArea = (): void => {
    const { clientWidth, clientHeight } = this.#frame.parentElement ?? this.#frame;
    const area = clientWidth * clientHeight;
    if (this.#area > 0 && area > 0) this.setSharpness(Math.min(1, Math.sqrt(this.#area / area)));
  };

  dispose(): void {
    this.#resized.disconnect();
    clearInterval(this.#watch);
    clearTimeout(this.#unreached);
    removeEventListener("message", this.#receive);
    this.#frame.remove();
  }

  #show(viewport: string): void {
    const { page, recording, dark } = this.#options;
    const address = viewportAddress(document.baseURI, viewport);
    address.searchParams.set("parent", location.origin);
    address.searchParams.set("page", page);
    if (recording !== null) address.searchParams.set("recording", recording);
    address.searchParams.set("look", dark ? "dark" : "light");
    clearTimeout(this.#unreached);
    this.#origin = address.origin;
    this.shared.value = this.#origin === location.origin;
    this.#frame.src = address.href;
    if (!this.shared.peek()) this.#fallBackIn(UNREACHED_MS);
  }

  #fallBackIn(ms: number): void {
    clearTimeout(this.#unreached);
    this.#unreached = window.setTimeout(() => this.#show(""), ms);
  }

  /** The load event also follows an error page of the browser. */
  readonly #onLoad = (): void => {
    if (!this.loaded.peek() && !this.shared.peek()) this.#fallBackIn(AFTER_LOAD_MS);
  };

  readonly #receive = (event: MessageEvent): void => {
    if (event.source !== this.#frame.contentWindow || event.origin !== this.#origin) return;
    const message = event.data as FromFrame | undefined;
    if (message?.tsd === 1) this.#handle(message);
  };

  #handle(message: FromFrame): void {
    this.#heardMs = performance.now();
    if (message.t === "loaded") {
      this.loaded.value = true;
      clearTimeout(this.#unreached);
      this.pause(this.#paused);
      const { clientWidth, clientHeight } = this.#frame.parentElement ?? this.#frame;
      this.#area = message.software ? clientWidth * clientHeight : 0;
    } else if (message.t === "ready") {
      this.ready.value = true;
      this.#frame.dataset["ready"] = "";
    } else if (message.t === "stalled") this.stalledMs.value = message.ms;
    else if (message.t === "key") this.#onKey(message);
    else if (message.t === "pointerdown") this.#options.onPointer?.(message.pointer);
  }

  #onKey(key: FrameKey): void {
    if (!key.down || key.repeat || document.activeElement !== this.#frame) return;
    this.#frame.blur();
    this.#options.onKey?.(key);
  }

  #checkSilence(): void {
    const silentMs = performance.now() - this.#heardMs;
    if (this.loaded.peek() && silentMs > SILENT_MS) this.stalledMs.value = Math.round(silentMs);
  }
}
