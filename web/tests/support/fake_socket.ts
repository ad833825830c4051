// Server end of a page's socket, and a separate window for each page of a test file.

import { vi } from "vitest";

export interface Message {
  t: string;
  [field: string]: unknown;
}

export class FakeSocket {
  static readonly OPEN = 1;
  static newest: FakeSocket;
  /** Lanes that pages have opened, oldest first. */
  static readonly lanes: FakeSocket[] = [];
  readonly OPEN = 1;
  readyState = FakeSocket.OPEN;
  bufferedAmount = 0;
  readonly sent: Message[] = [];
  onopen = () => {};
  onclose = () => {};
  onmessage = (_: { data: string }) => {};

  constructor(readonly address: URL) {
    if (!address.pathname.endsWith("/lane")) FakeSocket.newest = this;
    else {
      this.readyState = 0; // A test opens it.
      FakeSocket.lanes.push(this);
    }
  }

  /** Record a message; echo heartbeats immediately, so that the link stays connected. */
  send(text: string): void {
    const message = JSON.parse(text) as Message;
    this.sent.push(message);
    if (message.t === "heartbeat" && this.readyState === FakeSocket.OPEN)
      this.onmessage({ data: text });
  }

  close(): void {
    this.readyState = 3;
  }

  say(message: object): void {
    this.onmessage({ data: JSON.stringify(message) });
  }

  /**
   * Return the messages of these types, or all but heartbeats and views, and forget all. Numbers
   * that order them among sockets are omitted.
   */
  take(...types: string[]): Message[] {
    const isAsked = ({ t }: Message) =>
      types.length === 0 ? !["heartbeat", "view"].includes(t) : types.includes(t);
    const found = this.sent.splice(0).filter(isAsked);
    return found.map(({ number, selection, ...message }) =>
      message.t === "student" ? { ...message, number } : message,
    );
  }
}

type Listening = Parameters<typeof addEventListener>;
const listenings: Listening[] = [];
const listen: (...listening: Listening) => void = addEventListener;

/** Open a window: listeners of the page before, which would take the keys of the next, are gone. */
export function openWindow(): void {
  vi.stubGlobal("WebSocket", FakeSocket);
  FakeSocket.lanes.length = 0;
  for (const listening of listenings.splice(0)) removeEventListener(...listening);
  vi.stubGlobal("addEventListener", (...listening: Listening) => {
    listenings.push(listening);
    listen(...listening);
  });
}
