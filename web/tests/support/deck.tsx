// The deck on a page, with simulated input.

import { act } from "preact/test-utils";
import { Deck } from "../../src/deck/deck";
import { draw } from "./draw";
import { openPage } from "./page";

/** Open a page and draw its deck; changes made by `does` are drawn when it returns. */
export function openDeck() {
  const page = openPage();
  const box = document.body.appendChild(document.createElement("div"));
  draw(<Deck />, page.session, box);
  const does = (change: () => void) => void act(change);
  const find = (selector: string) => box.querySelector<HTMLElement>(selector);
  const text = (selector: string) =>
    (find(selector)?.textContent ?? "").replace(/\s+/g, " ").trim();
  const state = (...args: Parameters<typeof page.state>) => does(() => page.state(...args));
  const pass = (...args: Parameters<typeof page.pass>) => does(() => page.pass(...args));
  const say = (message: object) => does(() => page.say(message));
  return { ...page, box, does, find, text, state, pass, say };
}
