// The table of texts: one object per language, one module per area of the page. A text with
// figures is a function. The type check finds texts without a translation.

import { computed, type ReadonlySignal } from "@preact/signals";
import { isOneOf, remembered } from "../store/memory";
import { de } from "./de";
import { en } from "./en";

export type Texts = typeof en;

export const LANGUAGES = ["en", "de"] as const;
export type Language = (typeof LANGUAGES)[number];

const TABLES: Record<Language, Texts> = { en, de };

/** Language of the page: chosen here, else the first of the browser's that there is a table for. */
export const language = remembered<Language>("tsd-language", preferred(), isOneOf(LANGUAGES));

const table: ReadonlySignal<Texts> = computed(() => TABLES[language.value]);

/** Texts in the language of the page; components that call it follow a change. */
export function texts(): Texts {
  return table.value;
}

function preferred(): Language {
  const offered = navigator.languages.map((tag) => tag.slice(0, 2));
  return LANGUAGES.find((each) => offered.includes(each)) === undefined
    ? "en"
    : (offered.find((tag) => isOneOf(LANGUAGES)(tag)) as Language);
}
