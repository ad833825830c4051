// Lanes: WebSockets in addition to the main one, so that a lost segment stalls only some messages.

export const MAX_BUFFERED_BYTES = 1024; // Messages buffered in the browser would be too old to send.
/** A connection is lost after this time without a message while the page ran. */
export const SILENT_MS = 2000;
const LANES = 3;

interface Lane {
  socket: WebSocket;
  silentMs: number;
}

export class Lanes {
  #lanes: Lane[] = [];
  #turn = 0;

  constructor(
    private readonly address: () => URL,
    private readonly receive: (text: string) => void,
  ) {}

  /** Open all lanes and replace silent ones; the page ran for `ranMs` since the last call. */
  keep(ranMs: number): void {
    for (const lane of this.#lanes) {
      lane.silentMs += ranMs;
      if (lane.silentMs > SILENT_MS) this.#close(lane); // Also one that was refused.
    }
    while (this.#lanes.length < LANES) this.#open();
  }

  close(): void {
    for (const lane of this.#lanes) this.#close(lane);
  }

  get open(): WebSocket[] {
    return this.#lanes.map(({ socket }) => socket).filter((each) => each.readyState === each.OPEN);
  }

  /** Take turns among the main socket and the lanes that have sent all they were given. */
  next(main: WebSocket): WebSocket {
    const all = [main, ...this.open].filter((each) => each.bufferedAmount <= MAX_BUFFERED_BYTES);
    this.#turn += 1;
    return all[this.#turn % all.length] ?? main;
  }

  #open(): void {
    const lane = { socket: new WebSocket(this.address()), silentMs: 0 };
    this.#lanes = [...this.#lanes, lane];
    lane.socket.onmessage = ({ data }) => {
      lane.silentMs = 0;
      if (this.#lanes.includes(lane)) this.receive(data as string);
    };
  }

  #close(lane: Lane): void {
    this.#lanes = this.#lanes.filter((each) => each !== lane);
    lane.socket.close();
  }
}
