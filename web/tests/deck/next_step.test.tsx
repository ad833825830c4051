import { render } from "preact";
import { act } from "preact/test-utils";
import { beforeEach, expect, test, vi } from "vitest";
import { NextStep } from "../../src/ui/button";
import { fakeBrowser, fire } from "../support/page";

beforeEach(fakeBrowser);

function held() {
  const box = document.body.appendChild(document.createElement("div"));
  const pressed = vi.fn();
  const show = (refused: string | null, busy = false) =>
    void act(() =>
      render(
        <NextStep hold refused={refused} busy={busy} onPress={pressed}>
          Reset
        </NextStep>,
        box,
      ),
    );
  show(null);
  const node = box.querySelector("button")!;
  const does = (type: string, fields: object = {}) => void act(() => void fire(node, type, fields));
  const pass = (ms: number) => void act(() => void vi.advanceTimersByTime(ms));
  return { box, node, pressed, show, does, pass };
}

test("a long press acts after a second, and not when it ends before", () => {
  const { pressed, does, pass } = held();
  for (const end of ["pointerup", "pointerleave", "pointercancel", "blur"]) {
    does("pointerdown", { button: 0 });
    pass(900);
    does(end);
    pass(1000);
    expect(pressed, end).not.toHaveBeenCalled();
  }
  does("pointerdown", { button: 0 });
  pass(1000);
  does("pointerup");
  does("click", { detail: 1 });
  expect(pressed).toHaveBeenCalledTimes(1);
});

test("a refusal is told at once, and a press that outlasts it acts", () => {
  const { node, pressed, show, does, pass } = held();
  show("Let go of the stick first.");
  expect([node.title, node.getAttribute("aria-disabled")]).toEqual([
    "Let go of the stick first.",
    "true",
  ]);
  does("pointerdown", { button: 0 });
  pass(400);
  show(null);
  pass(600);
  expect(pressed).toHaveBeenCalledTimes(1);
});

test.each([
  ["refused", "Take control first.", false],
  ["under way", null, true],
])("a long press that is %s when it ends does not act", (_, refused, busy) => {
  const { pressed, show, does, pass } = held();
  does("pointerdown", { button: 0 });
  show(refused, busy);
  pass(1000);
  expect(pressed).not.toHaveBeenCalled();
});

test("a long press ends with its button", () => {
  const { box, pressed, does, pass } = held();
  does("pointerdown", { button: 0 });
  act(() => render(null, box));
  pass(1000);
  expect(pressed).not.toHaveBeenCalled();
});

test("assistive technology, which cannot hold, presses at once", () => {
  const { pressed, does } = held();
  does("click", { detail: 0 });
  expect(pressed).toHaveBeenCalledTimes(1);
});
