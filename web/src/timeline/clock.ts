// Times of day in the language of the page, and the grid of a timeline.

import { figure } from "../text/numbers";
import { language, texts } from "../text/text";

function format(ms: number, options: Intl.DateTimeFormatOptions): string {
  return new Intl.DateTimeFormat(language.value, { hourCycle: "h23", ...options }).format(ms);
}

/** Local time as 19:18, or 19:18:16. */
export function clock(ms: number, seconds = true): string {
  const second = seconds ? ({ second: "2-digit" } as const) : {};
  return format(ms, { hour: "2-digit", minute: "2-digit", ...second });
}

/** Local day and time, as "Today 19:10" or "20 November 11:20". */
export function day(ms: number): string {
  const [then, now] = [new Date(ms), new Date()];
  const year = then.getFullYear() === now.getFullYear() ? {} : ({ year: "numeric" } as const);
  const date =
    then.toDateString() === now.toDateString()
      ? texts().timeline.today
      : format(ms, { day: "numeric", month: "long", ...year });
  return `${date} ${clock(ms, false)}`;
}

export const iso = (ms: number): string => new Date(ms).toISOString();

export function megabytes(bytes: number): string {
  return texts().timeline.megabytes(figure(bytes / 1e6, bytes < 1e7 ? 1 : 0));
}

const STEPS_S = [
  1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200,
];
const TICK_PX = 96;

/** Times for a grid whose labels have room, at round local times. */
export function ticks(
  startMs: number,
  durationS: number,
  widthPx: number,
): { tS: number; text: string }[] {
  if (widthPx <= 0 || durationS <= 0) return [];
  const stepS = STEPS_S.find((step) => (step / durationS) * widthPx >= TICK_PX) ?? 86400;
  const localS = startMs / 1000 - 60 * new Date(startMs).getTimezoneOffset();
  const found = [];
  for (let tS = stepS - (localS % stepS); tS < durationS; tS += stepS)
    if ((1 - tS / durationS) * widthPx > TICK_PX / 2)
      found.push({ tS, text: clock(startMs + 1000 * tS, stepS < 60) });
  return found;
}

/** Seconds from 90, 1:30 or 1:02:03; null if it is not a time. */
export function parseTime(text: string): number | null {
  if (!/^\d+(:[0-5]?\d){0,2}([.,]\d+)?$/.test(text.trim())) return null;
  return text
    .trim()
    .replace(",", ".")
    .split(":")
    .reduce((total, part) => 60 * total + Number(part), 0);
}
