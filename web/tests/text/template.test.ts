import { describe, expect, test } from "vitest";

import { namesOf, parse, tableOf, type Value } from "../../src/text/template";

const ENGLISH = new Intl.PluralRules("en");

type Text = (...values: Value[]) => string;

const compiled = (english: string, translated = english, language = "en"): Text =>
  tableOf(english, translated, new Intl.PluralRules(language)) as Text;

describe("a text", () => {
  test("without places stays a string", () => {
    expect(tableOf("Use # and '.", "Nimm # und '.", ENGLISH)).toBe("Nimm # und '.");
  });

  test("takes its places in the order of the English text", () => {
    const text = compiled("{done} of {all} m", "Von {all} m sind {done} gefahren", "de");
    expect(text("1.5", 3)).toBe("Von 3 m sind 1.5 gefahren");
  });

  test("shows a value as it is, with braces and number signs", () => {
    expect(compiled("{name} drives")("{x} #1")).toBe("{x} #1 drives");
  });

  test("is selected by exact number, then by the plural category of the language", () => {
    const source = "{count, plural, =0 {no stop} one {# stop} other {# stops}}";
    expect([0, 1, 2].map((count) => compiled(source)(count))).toEqual([
      "no stop",
      "1 stop",
      "2 stops",
    ]);
    const polish = "{n, plural, one {# robot} few {# roboty} many {# robotów} other {# robota}}";
    const robots = [1, 3, 5, 1.5].map((n) => compiled("{n} robots", polish, "pl")(n));
    expect(robots).toEqual(["1 robot", "3 roboty", "5 robotów", "1.5 robota"]);
  });

  test("is selected by a word, a unit, a boolean, or a missing value", () => {
    const unit = compiled("{unit, select, m_s {metres per second} other {{unit}}}");
    expect(["m/s", "rpm", "constructor"].map((each) => unit(each))).toEqual([
      "metres per second",
      "rpm",
      "constructor",
    ]);
    const scaled = compiled("{percent} %{scaled, select, true {, scaled} other {}}.");
    expect([scaled(3, true), scaled(3, false)]).toEqual(["3 %, scaled.", "3 %."]);
    const driver = compiled("{name, select, none {nobody} other {{name}}} drives");
    expect([driver(null), driver(""), driver("Bob")]).toEqual([
      "nobody drives",
      "nobody drives",
      "Bob drives",
    ]);
  });

  test("has the number of the plural inside a selected branch", () => {
    const text = compiled(
      "{n, plural, other {# {robot, select, true {robots} other {twins #}}}}, #",
    );
    expect([text(2, true), text(3, false)]).toEqual(["2 robots, #", "3 twins 3, #"]);
  });

  test.each([
    ...["{", "}", "{}", "a {name", "{name}}", "{two words}", "{name, plural}"],
    ...["{n, plural, one}", "{n, plural, one {a}", "{n, date, other {a}}", "{n {a}}"],
  ])("with wrong braces is rejected: %s", (text) => {
    expect(() => parse(text)).toThrow("unexpected text");
  });

  test("names its places once, also those inside branches", () => {
    const parts = parse("{a} {n, plural, one {{b}} other {{a} #}} {c, select, other {c}}");
    expect(namesOf(parts)).toEqual(["a", "n", "b", "c"]);
  });
});

test("A table keeps its nesting and lists.", () => {
  const english = { inner: { list: ["one", "{n} things"], "m/s": "metres" }, flat: "text" };
  const table = tableOf(english, english, ENGLISH) as {
    inner: { list: [string, Text]; "m/s": string };
    flat: string;
  };
  expect([table.inner.list[0], table.inner.list[1](2)]).toEqual(["one", "2 things"]);
  expect([table.inner.list.length, table.inner["m/s"], table.flat]).toEqual([2, "metres", "text"]);
});
