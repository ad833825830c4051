// The texts of the page: places and plurals of all languages, and keys that are unions of the page.

import { expect, test } from "vitest";

import type { Table } from "../../src/generated/texts";
import type { CameraPreset, Layer, RobotState, TruePoseDisplay } from "../../src/generated/wire";
import { actuator, remedyOf } from "../../src/health/rows";
import type { PageCode } from "../../src/store/permission";
import type { Sharpness } from "../../src/store/view";
import de from "../../src/text/de.json";
import en from "../../src/text/en.json";
import { parse, type Source } from "../../src/text/template";
import { type Language, LANGUAGES, language, texts } from "../../src/text/text";

const SOURCES: Record<Language, Source> = { en, de };

type Same<A, B> = [A, B] extends [B, A] ? true : false;
type View = Table["panel"]["view"];

/** Each entry is an error of the type check if a table lacks a key of its union or has another. */
const UNIONS: [
  Same<keyof Table["common"]["refusals"], PageCode>,
  Same<keyof Table["scene"]["cameras"], CameraPreset | "label">,
  Same<keyof Table["panel"]["wheels"]["heldBack"], NonNullable<RobotState["limit"]>>,
  Same<keyof View["sharpnesses"], Sharpness>,
  Same<keyof View["layer"], Layer>,
  Same<keyof View["truePoses"], TruePoseDisplay>,
  Same<keyof View["languages"], Language>,
] = [true, true, true, true, true, true, true];

test("Tables have the keys of their unions.", () => expect(UNIONS).not.toContain(false));

function leaves(source: Source): string[] {
  return typeof source === "string" ? [source] : Object.values(source).flatMap(leaves);
}

type Parts = ReturnType<typeof parse>;

/** Return all places of a text that have branches. */
function choices(parts: Parts): Exclude<Parts[number], string>[] {
  return parts.flatMap((part) => {
    if (typeof part === "string") return [];
    const inside = [...part.branches.values()].flatMap((each) => choices(each as Parts));
    return part.kind === undefined ? inside : [part, ...inside];
  });
}

test.each(LANGUAGES)("%s has a branch for all other values and each plural category", (each) => {
  const { pluralCategories } = new Intl.PluralRules(each).resolvedOptions();
  const found = leaves(SOURCES[each]).flatMap((text) => choices(parse(text)));
  expect(found.length).toBeGreaterThan(0);
  for (const { name, kind, branches } of found) {
    const keys = [...branches.keys()];
    expect(keys, name).toContain("other");
    if (kind !== "plural") continue;
    const known = keys.filter((key) => !key.startsWith("="));
    expect(pluralCategories, name).toEqual(expect.arrayContaining(known));
    const isExact = keys.some((key) => key.startsWith("=")) && known.length === 1;
    if (!isExact) expect(known, name).toEqual(expect.arrayContaining(pluralCategories));
  }
});

test.each(LANGUAGES)("In %s actuators have names, and each remedy names its limit", (each) => {
  language.value = each;
  const { health, panel } = texts();
  expect(actuator("module2")).toBe(panel.wheels.module(2));
  expect(actuator("wheel10")).toBe(panel.wheels.wheelNumber(10));
  expect(actuator("left_leg")).toBe("left leg");
  for (const row of Object.keys(health.remedies)) expect(remedyOf(row, "7 ms")).not.toBe("");
  expect(remedyOf("age", "7 ms")).toContain("7 ms");
});
