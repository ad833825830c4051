// Pictures of cameras: WebSockets that deliver one picture per request, and the age of the latest
// picture. The dashboard sends each picture once to this page, over any free WebSocket.

import { computed, effect, type Signal, signal } from "@preact/signals";
import type { CameraEntry, PictureRequest } from "../generated/wire";
import type { Drive } from "../drive/drive";
import { type Link, socketAddress } from "../store/link";
import { isFlag, isText, remembered } from "../store/memory";
import { answer } from "../timeline/library";
import { decodesH264, JPEG, PictureDecoder } from "./picture_decoder";

/** From this age on a picture is marked, and a robot that is driven by it slows down. */
export const LATE_MS = 300;
/** From this age on it is greyed, and nothing is driven by it. */
export const OLD_MS = 1000;

const MAX_SOCKETS = 8; // A lost packet stalls a single socket.
const ADD_AFTER_MS = 2000;
const MANY_SKIPPED = 0.2; // Fraction of pictures that no free socket could take.
const HEADER_BYTES = 28;
const RETRY_MS = 1000;
const DELAYS = 100;

/** Tags that were found in a picture, in pixels of a picture of this size. */
export interface Outlines {
  size: [number, number];
  tags: readonly { robot: string | null; corners: [number, number][]; refused: string | null }[];
}

export class PictureFeed {
  readonly cameras = signal<readonly CameraEntry[]>([]);
  readonly open: Signal<boolean>;
  /** Whether the picture is the main view, and the scene small. */
  readonly main = signal(false);
  readonly outlines = signal<Outlines | null>(null);
  /** Width of the pane in pixels of the screen. */
  widthPx = 320;
  /** Whether the scene is drawn without a graphics card; H.264 is slow to convert there. */
  software = false;
  readonly #key = remembered("tsd-camera", "", isText);
  /** Cameras of the robot and above the floor. */
  readonly seen = computed(() => {
    const robot = this.link.robot.value?.id;
    return this.cameras.value.filter((each) => each.robot === null || each.robot === robot);
  });
  #last: CameraEntry | null = null;
  /**
   * Camera that is looked at: the chosen one, or one of the robot, or one above the floor. A lost
   * camera stays selected while it is the main view, and its picture ages.
   */
  readonly camera = computed(() => {
    const [seen, chosen] = [this.seen.value, this.#key.value];
    const kept = this.main.value ? this.#last : null;
    const found = seen.find(({ key }) => key === (kept?.key ?? chosen)) ?? kept;
    return (this.#last = found ?? seen.find((each) => each.robot !== null) ?? seen[0] ?? null);
  });
  /** Key of the camera whose pictures the page receives, or null. */
  readonly #watched = computed(() => {
    const isShown = this.open.value && this.link.connected.value;
    return isShown ? (this.camera.value?.key ?? null) : null;
  });
  /** Middle of the exposure of the latest picture on the `performance.now` clock. */
  #exposedMs = -Infinity;
  #sinceMs = performance.now();
  #number = 0;
  #got = 0;
  #skipped = 0;
  #addedMs = 0;
  #delays: number[] = [];
  #sockets = new Set<WebSocket>();
  /** Requests that wait for the next frame. */
  #due: (() => void)[] = [];
  #h264 = false;
  #canvas: HTMLCanvasElement | null = null;

  constructor(
    readonly link: Link,
    drive: Drive,
    isNarrow = false,
  ) {
    this.open = remembered("tsd-pictures", !isNarrow, isFlag);
    void decodesH264().then((does) => (this.#h264 = does));
    const refresh = () => void this.#fetch();
    link.on("welcome", refresh);
    link.on("cameras_changed", refresh);
    effect(() => {
      const key = this.#watched.value;
      if (key !== null) this.#start(key);
      return () => this.#stop();
    });
    const robot = computed(() => link.robot.value?.id);
    effect(() => {
      void robot.value;
      this.main.value = false;
    });
    effect(() => {
      void link.beat.value;
      drive.caution.value = this.main.value ? caution(this.ageMs()) : 1;
    });
  }

  choose(key: string): void {
    this.#last = null;
    this.#key.value = key;
  }

  toggle(): void {
    this.open.value = !this.open.peek();
    this.main.value = false;
  }

  drawOn(canvas: HTMLCanvasElement): () => void {
    this.#canvas = canvas;
    return () => (this.#canvas = null);
  }

  /** Whether there has been a picture. */
  get isShown(): boolean {
    return this.#exposedMs > -Infinity;
  }

  /** Age of the latest picture; before the first one, the waiting time. */
  ageMs(): number {
    return performance.now() - (this.isShown ? this.#exposedMs : this.#sinceMs);
  }

  async #fetch(): Promise<void> {
    if (this.link.recording !== null) return;
    const found = await answer("GET", "cameras").catch(() => null);
    this.cameras.value = found ? ((await found.json()) as CameraEntry[]) : [];
  }

  #start(key: string): void {
    this.#number = this.#got = this.#skipped = 0;
    this.#delays = [];
    this.#exposedMs = -Infinity;
    this.#sinceMs = this.#addedMs = performance.now();
    this.#connect(key);
  }

  #stop(): void {
    for (const socket of this.#sockets) socket.close();
    this.#sockets.clear();
    this.outlines.value = null;
  }

  #connect(key: string): void {
    const socket = new WebSocket(socketAddress("pictures", { page: this.link.page, camera: key }));
    socket.binaryType = "arraybuffer";
    this.#sockets.add(socket);
    socket.onopen = () => this.#ask(socket);
    const decoder = new PictureDecoder();
    socket.onmessage = ({ data }) => void this.#take(socket, decoder, data as ArrayBuffer, key);
    socket.onclose = () => {
      decoder.close();
      if (!this.#sockets.delete(socket) || this.#sockets.size > 0) return;
      this.#delays = [];
      this.#number = 0;
      setTimeout(
        () => this.#sockets.size === 0 && this.#watched.peek() === key && this.#connect(key),
        RETRY_MS,
      );
    };
  }

  /** Ask for at most one picture per frame; the page would decode more, but not show them. */
  #askInFrame(socket: WebSocket, arrivedMs: number): void {
    this.#due.push(() => this.#ask(socket, arrivedMs));
    if (this.#due.length === 1) requestAnimationFrame(this.#askNext);
  }

  readonly #askNext = (): void => {
    this.#due.shift()?.();
    if (this.#due.length > 0) requestAnimationFrame(this.#askNext);
  };

  #ask(socket: WebSocket, arrivedMs = performance.now()): void {
    const request: PictureRequest = {
      width: Math.round(this.widthPx),
      rtt_ms: Math.min(this.link.pageMs ?? 0, ...this.link.trips),
      held_ms: performance.now() - arrivedMs,
      h264: this.#h264 && !this.software,
    };
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(request));
  }

  async #take(socket: WebSocket, decoder: PictureDecoder, data: ArrayBuffer, key: string) {
    const arrivedMs = performance.now();
    const header = new DataView(data, 0, HEADER_BYTES);
    const [ageMs, sentMs] = [header.getFloat64(0, true), header.getFloat64(8, true)];
    const [number, outlines] = [header.getUint32(16, true), header.getUint32(20, true)];
    const [coding, start] = [header.getUint32(24, true), HEADER_BYTES + outlines];
    this.#delays = [...this.#delays, arrivedMs - sentMs].slice(-DELAYS);
    const clockMs = Math.min(...this.#delays) - (this.link.pageMs ?? 0) / 2;
    this.#add(key, number);
    const bitmap = await decoder.decode(coding, number, new Uint8Array(data, start));
    this.#h264 &&= bitmap !== null || coding === JPEG || !this.#sockets.has(socket);
    this.#askInFrame(socket, arrivedMs);
    if (bitmap === null) return;
    const canvas = this.#canvas; // Without one the picture is not shown, so its age does not count.
    if (number < this.#number || !this.#sockets.has(socket) || !canvas) return bitmap.close();
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height)
      Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
    // Drawing would wait for the GPU's process, where viser may draw in software for 0.4 s.
    canvas.getContext("bitmaprenderer")?.transferFromImageBitmap(bitmap);
    this.#exposedMs = sentMs + clockMs - ageMs;
    this.outlines.value = parsed(data.slice(HEADER_BYTES, start));
  }

  /** Count a picture; open another socket where many wait for a free one. */
  #add(key: string, number: number): void {
    this.#got += 1;
    if (this.#number > 0 && number > this.#number) this.#skipped += number - this.#number - 1;
    this.#number = Math.max(this.#number, number);
    if (performance.now() - this.#addedMs < ADD_AFTER_MS) return;
    const isStalled =
      this.#due.length === 0 && this.#skipped > MANY_SKIPPED * (this.#got + this.#skipped);
    if (isStalled && this.#sockets.size < MAX_SOCKETS) this.#connect(key);
    this.#addedMs = performance.now();
    this.#got = this.#skipped = 0;
  }
}

/** Fraction of the speed for driving by a picture of an age: zero stops the robot. */
export function caution(ageMs: number): number {
  return Math.min(1, Math.max(0, (OLD_MS - ageMs) / (OLD_MS - LATE_MS)));
}

function parsed(data: ArrayBuffer): Outlines | null {
  if (data.byteLength === 0) return null;
  try {
    return JSON.parse(new TextDecoder().decode(data)) as Outlines;
  } catch {
    return null; // Any program on the bus can send it.
  }
}
