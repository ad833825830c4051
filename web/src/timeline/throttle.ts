import type { PageMessage, RecordedPageMessage } from "../generated/wire";
import type { Link } from "../store/link";

const SEND_MS = 50; // The dashboard closes sockets that flood it.

/** Sends the latest of several messages in quick succession. */
export class Throttle {
  readonly #link: Link;
  #waiting: PageMessage | RecordedPageMessage | null = null;
  #timer = 0;

  constructor(link: Link) {
    this.#link = link;
  }

  send(message: PageMessage | RecordedPageMessage): void {
    this.#waiting = message;
    if (this.#timer === 0) this.#flush();
  }

  /** Drop the message that waits. */
  cancel(): void {
    this.#waiting = null;
  }

  #flush(): void {
    this.#timer = 0;
    if (this.#waiting === null) return;
    this.#link.send(this.#waiting);
    this.#waiting = null;
    this.#timer = window.setTimeout(() => this.#flush(), SEND_MS);
  }
}
