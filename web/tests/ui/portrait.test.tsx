import { render } from "preact";
import { act } from "preact/test-utils";
import { afterEach, expect, test } from "vitest";

import { Portrait } from "../../src/ui/portrait";

const root = document.body.appendChild(document.createElement("div"));
const show = (robot: string) =>
  act(() =>
    render(
      <Portrait robot={robot}>
        <i>drawing</i>
      </Portrait>,
      root,
    ),
  );
const picture = () => root.querySelector("img")!;
const happens = (what: string) => act(() => void picture().dispatchEvent(new Event(what)));
const isShown = () => [!picture().hidden, root.textContent === ""];

afterEach(() => render(null, root));

test("A drawing stands in for a portrait until it is loaded, and for one that is missing.", async () => {
  await show("tsd");
  expect(picture().getAttribute("src")).toBe("portraits/tsd");
  expect(isShown()).toEqual([false, false]);
  await happens("load");
  expect(isShown()).toEqual([true, true]);
  await happens("error");
  expect(isShown()).toEqual([false, false]);
});

test("The portrait of a robot is never shown for another.", async () => {
  await show("tsd");
  await happens("load");
  await show("kiwi");
  expect(picture().getAttribute("src")).toBe("portraits/kiwi");
  expect(isShown()).toEqual([false, false]);
});
