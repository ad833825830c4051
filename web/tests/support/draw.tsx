// Draws a part of the page around a session.

import { type ComponentChild, render } from "preact";
import { act } from "preact/test-utils";
import { type Session, SessionContext } from "../../src/session";

/** Draw a part of the page; its effects have run on return. */
export function draw(part: ComponentChild, session: Partial<Session>, box: Element): void {
  const page = <SessionContext.Provider value={session as Session}>{part}</SessionContext.Provider>;
  void act(() => render(page, box));
}
