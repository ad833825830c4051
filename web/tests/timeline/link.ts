// A link whose socket is the test.

import { Link } from "../../src/store/link";
import { FakeSocket, openWindow } from "../support/fake_socket";

/** Open a link; it sends to `sent` and receives by `hear`. */
export function openLink(recording: string | null = null) {
  openWindow();
  const link = new Link("0123456789abcdef", recording);
  link.open();
  const socket = FakeSocket.newest;
  socket.onopen();
  socket.take();
  return { link, sent: socket.sent, hear: (message: object) => socket.say(message) };
}

export type Wire = ReturnType<typeof openLink>;

export const WELCOME = { t: "welcome", operator: "web-1", name: "", role: "operator", user: null };
