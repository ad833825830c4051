// The one answer to "is what I see true now?"; all texts, colours and figures ask it.

import type { Link } from "./link";

export const STALE_MS = 300;

export type Freshness =
  /** The first state is still expected. */
  | { kind: "starting" }
  | { kind: "no_robot" }
  /** The page has lost the dashboard. */
  | { kind: "offline"; forMs: number }
  /** The dashboard has lost the robot. */
  | { kind: "silent"; forMs: number }
  /** The page has opened a recording, or an operator replays one on the bus. */
  | { kind: "recorded"; by: "page" | "bus" }
  | { kind: "live" };

/** Evaluate now; read `link.beat` to follow it. */
export function freshness(link: Link): Freshness {
  if (!link.connected.value) {
    if (link.isLoading()) return { kind: "starting" };
    return { kind: "offline", forMs: performance.now() - link.lostMs };
  }
  const state = link.state.value;
  if (link.robot.value === null)
    return link.isLoading() ? { kind: "starting" } : { kind: "no_robot" };
  if (link.recording !== null) return { kind: "recorded", by: "page" };
  const ageMs = link.ageMs();
  if (state === null || ageMs > STALE_MS)
    return link.isLoading() ? { kind: "starting" } : { kind: "silent", forMs: ageMs };
  return state.source === "recording" ? { kind: "recorded", by: "bus" } : { kind: "live" };
}

/** Whether figures are current: live, or at the cursor of a recording. */
export function isCurrent({ kind }: Freshness): boolean {
  return kind === "live" || kind === "recorded";
}
