// Times of day in the language of the page, and the grid of a timeline.

import type { ComponentChildren } from "preact";
import { figure, language, texts } from "../text/text";

/** Local time as 19:18:16, or 19:18. */
export function clock(ms: number, timeStyle: "medium" | "short" = "medium"): string {
  return new Date(ms).toLocaleTimeString(language.value, { timeStyle, hourCycle: "h23" });
}

/** Local day and time, as "Today 19:10" or "20 November 2025 11:20". */
export function day(ms: number): string {
  const date = new Date(ms);
  const isToday = date.toDateString() === new Date().toDateString();
  const named = date.toLocaleDateString(language.value, { dateStyle: "long" });
  return `${isToday ? texts().timeline.today : named} ${clock(ms, "short")}`;
}

export const iso = (ms: number): string => new Date(ms).toISOString();

/** A time, with the exact one in its title. */
export function Moment({ atMs, children }: { atMs: number; children: ComponentChildren }) {
  return (
    <time dateTime={iso(atMs)} title={iso(atMs)}>
      {children}
    </time>
  );
}

/** An event of a feed, with its time. */
export function FeedLine({ atMs, children }: { atMs: number; children: ComponentChildren }) {
  return (
    <li>
      <Moment atMs={atMs}>{clock(atMs)}</Moment>
      <span>{children}</span>
    </li>
  );
}

export function megabytes(bytes: number): string {
  return texts().timeline.megabytes(figure(bytes / 1e6, bytes < 1e7 ? 1 : 0));
}

const STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600];

/** At most ten round local times for a grid; their labels have room at the right. */
export function ticks(startMs: number, durationS: number): { tS: number; text: string }[] {
  const stepS = STEPS_S.find((step) => 10 * step >= durationS) ?? 86400;
  const localS = startMs / 1000 - 60 * new Date(startMs).getTimezoneOffset();
  const found = [];
  for (let tS = stepS - (localS % stepS); tS < 0.93 * durationS; tS += stepS)
    found.push({ tS, text: clock(startMs + 1000 * tS, stepS < 60 ? "medium" : "short") });
  return found;
}
