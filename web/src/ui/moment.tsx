// Times of day in the language of the page.

import type { ComponentChildren } from "preact";
import { language } from "../text/text";

/** A time, with the exact one in its title. */
export function Moment({ atMs, children }: { atMs: number; children: ComponentChildren }) {
  const iso = new Date(atMs).toISOString();
  return (
    <time dateTime={iso} title={iso}>
      {children}
    </time>
  );
}

/** An event of a feed, with its time. */
export function FeedLine({ atMs, children }: { atMs: number; children: ComponentChildren }) {
  const time = new Date(atMs).toLocaleTimeString(language.value, { timeStyle: "medium" });
  return (
    <li>
      <Moment atMs={atMs}>{time}</Moment>
      <span>{children}</span>
    </li>
  );
}
