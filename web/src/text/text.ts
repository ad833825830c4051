// Texts and figures of the page in its language. Texts have one file per language: `en.json`,
// `de.json`; a text with places is a function of their values. A new language also needs its
// sentences of codes, in `reasons.ts`. An unknown figure is an en dash.

import { computed } from "@preact/signals";
import type { Table } from "../generated/texts";
import { isOneOf, remembered } from "../store/memory";
import de from "./de.json";
import en from "./en.json";
import { tableOf } from "./template";

export const LANGUAGES = ["en", "de"] as const;
export type Language = (typeof LANGUAGES)[number];

/** The type check finds keys without a translation. */
const SOURCES: Record<Language, typeof en> = { en, de };

const preferred = navigator.languages.map((tag) => tag.slice(0, 2)).find(isOneOf(LANGUAGES));
/** Language of the page: chosen here, else the first of the browser's that there is a table for. */
export const language = remembered<Language>("tsd-language", preferred ?? "en", isOneOf(LANGUAGES));

const table = computed(() => {
  return tableOf(en, SOURCES[language.value], new Intl.PluralRules(language.value)) as Table;
});

/** Texts in the language of the page; components that call it follow a change. */
export function texts(): Table {
  return table.value;
}

const formats = new Map<string, Intl.NumberFormat>();

export function figure(value: number | null | undefined, decimals = 0): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const key = `${language.value} ${decimals}`;
  const format =
    formats.get(key) ??
    new Intl.NumberFormat(language.value, {
      minimumFractionDigits: decimals,
      maximumFractionDigits: decimals,
      signDisplay: "negative",
    });
  formats.set(key, format);
  return format.format(value).replaceAll("-", "−");
}

export function degrees(radians: number | null | undefined): number | null {
  return radians === null || radians === undefined ? null : (radians * 180) / Math.PI;
}

/** Duration as 7 s, 2:05 or 1:02:05. */
export function duration(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds));
  if (whole < 60) return `${whole} s`;
  const two = (part: number) => String(part).padStart(2, "0");
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  const start = hours > 0 ? `${hours}:${two(minutes)}` : minutes;
  return `${start}:${two(whole % 60)}`;
}
