import { render } from "preact";
import { act } from "preact/test-utils";
import { afterEach, expect, test, vi } from "vitest";
import { Button } from "../../src/ui/button";

afterEach(() => render(null, document.body));

test("A refused button says why for as long as that holds, keeps the focus, and does nothing.", () => {
  const pressed = vi.fn();
  const show = (text: string, refused: string | null) =>
    act(() =>
      render(
        <Button refused={refused} onPress={pressed}>
          {text}
        </Button>,
        document.body,
      ),
    );
  const button = () => document.querySelector("button")!;
  show("Take over", null);
  const before = button();
  before.focus();
  expect(button().title).toBe("");
  show("Withdraw", "Not now.");
  expect(button()).toBe(before);
  expect([document.activeElement, button().getAttribute("aria-disabled")]).toEqual([
    before,
    "true",
  ]);
  expect(button().title).toBe("Not now.");
  button().click();
  expect(pressed).not.toHaveBeenCalled();
  show("Withdraw", null);
  expect([button().title, button().hasAttribute("aria-disabled")]).toEqual(["", false]);
  button().click();
  expect(pressed).toHaveBeenCalledTimes(1);
});
