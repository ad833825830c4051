// The panel on a page, with simulated input.

import { act } from "preact/test-utils";
import { Panel } from "../../src/panel/panel";
import { draw } from "./draw";
import { fire, openPage, place, ROBOT } from "./page";

const axis = (symbol: string, unit: string) => ({ name: symbol, symbol, unit });

/** A robot with three modules on the floor, whole. */
export const GIMBALS = {
  ...ROBOT,
  twist_axes: [axis("vx", "m/s"), axis("vy", "m/s"), axis("ω", "rad/s")],
  joints: [],
  wheels: [],
  not_promised: [],
  wheel_speed_limits: null,
  alternative_estimate: null,
};

/** Open a page and draw its panel; changes made by `does` are drawn when it returns. */
export function openPanel() {
  const page = openPage();
  const consistency = { residual_mps: 0, suspect: null, level: 0, contributions: {} };
  type State = Parameters<typeof page.state>;
  const send = (status: State[0] = {}, fields: State[1] = {}) =>
    page.state({ consistency, ...status }, { modules: [], wheels: [], joints: [], ...fields });
  page.say(GIMBALS);
  send();
  const box = document.body.appendChild(document.createElement("div"));
  draw(<Panel />, page.session, box);
  const does = (change: () => void) => void act(change);
  const find = (selector: string) => box.querySelector<HTMLElement>(selector)!;
  const text = (selector: string) => (find(selector)?.textContent ?? "").replace(/\s+/g, " ");
  /** Press a button, tab or choice by its text or label. */
  const click = (name: string) => {
    const all = [...box.querySelectorAll<HTMLElement>("button")];
    const one = all.find((each) =>
      [each.textContent, each.getAttribute("aria-label")].includes(name),
    );
    does(() => one!.click());
  };
  const state = (...args: State) => does(() => send(...args));
  /** Advance the time; with a `status`, the robot sends a state every 50 ms. */
  const pass = (ms: number, status?: State[0]) =>
    does(() => {
      for (let i = 0; i < ms; i += 10) {
        page.pass(10);
        if (status && i % 50 === 40) send(status);
      }
    });
  const say = (message: object) => does(() => page.say(message));
  /** Drag the thumb of a labelled slider to `share` of its range, from -1 (left) to 1. */
  const drag = (label: string, share: number) => {
    const track = find(`[aria-label="${label}"][role=slider]`);
    place(track, 200, 44);
    const at = { pointerId: 1, button: 0, clientX: 100 + 100 * share };
    does(() => void fire(track, "pointerdown", { ...at, clientX: 100 }));
    does(() => void fire(track, "pointermove", at));
    return {
      track,
      letGo: () => does(() => void fire(track, "pointerup", at)),
      lose: () => does(() => void fire(track, "pointercancel", at)),
    };
  };
  return { ...page, box, does, find, text, click, state, pass, say, drag };
}
