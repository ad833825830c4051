import { expect, test } from "vitest";

import { PARAMETERS, type Code } from "../../src/generated/codes";
import { en, type Sentences } from "../../src/generated/sentences";
import de from "../../src/text/de_sentences.json";

const LANGUAGES: Record<string, Sentences> = { en, de };
const SLOT = /\{(\w+)(?::[+,]?(?:\.\d)?)?\}/g;

function slots(template: string): string[] {
  return [...template.matchAll(SLOT)].map(([, name]) => name as string);
}

test.each(Object.entries(LANGUAGES))("%s has a sentence for each code", (_, { templates }) => {
  expect(Object.keys(templates).sort()).toEqual(Object.keys(PARAMETERS).sort());
  expect(Object.values(templates)).not.toContain("");
});

test.each(Object.entries(LANGUAGES))("%s shows only parameters that a code has", (_, language) => {
  for (const [code, template] of Object.entries(language.templates)) {
    const names = Object.keys(PARAMETERS[code as Code]);
    expect(names, code).toEqual(expect.arrayContaining(slots(template)));
    expect(template.replaceAll(SLOT, ""), code).not.toMatch(/[{}]/);
  }
});

test.each(Object.entries(LANGUAGES))(
  "%s leaves out no parameter that English shows",
  (_, other) => {
    for (const [code, template] of Object.entries(en.templates)) {
      const translated = new Set(slots(other.templates[code as Code]));
      expect([...translated].sort(), code).toEqual([...new Set(slots(template))].sort());
    }
  },
);
