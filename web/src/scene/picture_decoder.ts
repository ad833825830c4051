// Decoder of the pictures on one WebSocket: JPEG, or H.264, where each depends on the ones before.

const CONFIG: VideoDecoderConfig = { codec: "avc1.64002a", optimizeForLatency: true };
export const GIVE_UP_MS = 3000; // The first picture takes long on a loaded machine.
export const JPEG = 0;
const KEY_FRAME = 2;

/** Return whether this page can decode H.264; WebCodecs exist in secure contexts only. */
export async function decodesH264(): Promise<boolean> {
  if (!("VideoDecoder" in window)) return false;
  return (await VideoDecoder.isConfigSupported(CONFIG)).supported === true;
}

export class PictureDecoder {
  #h264: VideoDecoder | null = null;
  #done = (_: VideoFrame | null) => {};

  /** Decode the next picture, or return null; H.264 has failed then. */
  async decode(coding: number, number: number, data: BufferSource): Promise<ImageBitmap | null> {
    if (coding === JPEG)
      return createImageBitmap(new Blob([data], { type: "image/jpeg" })).catch(() => null);
    const decoded = new Promise<VideoFrame | null>((done) => (this.#done = done));
    setTimeout(this.#done, GIVE_UP_MS, null); // A decoder that holds pictures back is of no use.
    try {
      this.#h264 ??= new VideoDecoder({
        output: (frame) => this.#done(frame),
        error: () => this.#done(null),
      });
      if (coding === KEY_FRAME) this.#h264.configure(CONFIG); // The size may have changed.
      const type = coding === KEY_FRAME ? "key" : "delta";
      this.#h264.decode(new EncodedVideoChunk({ type, timestamp: number, data }));
    } catch {
      this.#done(null);
    }
    const frame = await decoded;
    const bitmap = frame?.timestamp === number ? await createImageBitmap(frame) : null;
    frame?.close();
    return bitmap;
  }

  close(): void {
    if (this.#h264?.state === "configured") this.#h264.close();
  }
}
