// A link whose socket is the test.

import { vi } from "vitest";
import { Link } from "../../src/store/link";

export interface Wire {
  link: Link;
  sent: { t: string }[];
  hear: (message: object) => void;
}

/** Open a link; it sends to `sent` and receives by `hear`. */
export function openLink(recording: string | null = null): Wire {
  const sent: { t: string }[] = [];
  const sockets: FakeSocket[] = [];
  class FakeSocket {
    static readonly OPEN = 1;
    readonly readyState = 1;
    readonly bufferedAmount = 0;
    onopen = () => {};
    onmessage = (_: { data: string }) => {};
    onclose = () => {};
    constructor() {
      sockets.push(this);
    }
    send(text: string): void {
      const message = JSON.parse(text) as { t: string };
      sent.push(message);
      if (message.t === "heartbeat") this.onmessage({ data: text }); // The link stays connected.
    }
    close(): void {}
  }
  vi.stubGlobal("WebSocket", FakeSocket);
  const link = new Link({ page: "0123456789abcdef", recording, name: "", hasFocus: () => true });
  link.open();
  sockets.at(-1)!.onopen();
  sent.length = 0;
  return {
    link,
    sent,
    hear: (message) => sockets.at(-1)!.onmessage({ data: JSON.stringify(message) }),
  };
}

export const WELCOME = { t: "welcome", operator: "web-1", name: "", role: "operator", user: null };
