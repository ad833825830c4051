import { expect, test } from "vitest";
import { fieldsOf } from "../../src/plots/fields.ts";
import { decode, encode, fits, homeOf, moved, usualLayout } from "../../src/plots/layout.ts";
import { ROBOT, STATE } from "../support/fake_link.ts";

const KNOWN = fieldsOf(ROBOT, STATE);
const PANES = [["twist.vx", "twist.vy"], ["twist.omega"]];

test("A moved field is in one pane, and panes without fields are gone.", () => {
  expect(moved(PANES, "twist.vy", 1)).toEqual([["twist.vx"], ["twist.omega", "twist.vy"]]);
  expect(moved(PANES, "twist.vx", 2)).toEqual([["twist.vy"], ["twist.omega"], ["twist.vx"]]);
  expect(moved(PANES, "twist.omega", null)).toEqual([["twist.vx", "twist.vy"]]);
  expect(moved(PANES, "twist.omega", 0)).toEqual([["twist.vx", "twist.vy", "twist.omega"]]);
});

test("A new field joins its like, and no pane has a third unit.", () => {
  expect(homeOf(PANES, KNOWN.get("commanded.vx")!, KNOWN)).toBe(0);
  expect(homeOf(PANES, KNOWN.get("pose.x")!, KNOWN)).toBe(PANES.length);
  expect(fits(["twist.vx"], KNOWN.get("twist.omega")!, KNOWN)).toBe(true);
  expect(fits(["twist.vx", "twist.omega"], KNOWN.get("pose.x")!, KNOWN)).toBe(false);
  expect(fits(["twist.vx", "twist.omega"], KNOWN.get("twist.vy")!, KNOWN)).toBe(true);
});

test("A layout as text is read as it was written; damaged texts are refused.", () => {
  const layout = { windowS: 12.5, panes: [["a.b", "odd,;: name"], ["µ%"]] };
  expect(decode(encode(layout))).toEqual(layout);
  for (const text of [null, 7, "", "20", "x:a", "0:a", "601:a", "20:%"])
    expect(decode(text), String(text)).toBe(null);
});

test("Each kind of robot has usual plots, of one unit each.", () => {
  for (const panel of ["gimbals", "joints", "sphere", "twist", "wheels"] as const) {
    const robot = { ...ROBOT, panel, wheels: ["wheel1"] };
    const known = fieldsOf(robot, { ...STATE, wheels: [{ rpm: 1, rpm_setpoint: 1 }] });
    for (const pane of usualLayout(robot).panes)
      expect(new Set(pane.flatMap((name) => known.get(name)?.unit ?? [])).size).toBeLessThan(2);
  }
});
