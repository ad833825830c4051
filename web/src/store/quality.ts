// Grade of the link from page to robot, and the figure that explains the grade.

import { freshness } from "./freshness";
import type { Link } from "./link";

// Relative to the maximum command age.
export const GOOD = 0.4;
export const FAIR = 0.8;
export const GOOD_LOSS = 0.05;
export const FAIR_LOSS = 0.2;

export interface Quality {
  grade: "good" | "uneven" | "slow" | "lossy" | "none";
  /** Whether commands arrive too late or not at all at times. */
  bad: boolean;
  /** What the grade is about: ms of the round trip or of its jitter, or percent of lost states. */
  figure: { value: number; unit: "ms" | "%" } | null;
}

/** Round trip from page to robot in ms, or null if unknown. */
export function roundTripMs(link: Link): number | null {
  const robotMs = link.state.value?.rtt_ms ?? null;
  if (!link.connected.value || link.pageMs === null || robotMs === null) return null;
  return link.pageMs + robotMs;
}

/** 95th percentile of the round trip minus its median in ms, or null if unknown. */
export function jitterMs(link: Link): number | null {
  if (roundTripMs(link) === null) return null;
  return (link.pageJitterMs ?? 0) + (link.state.value?.rtt_jitter_ms ?? 0);
}

/**
 * Grade the link by round trip plus jitter, relative to the maximum command age.
 * On arrival, a command is up to one state period (50 ms) older than that, so above 0.8 some arrive
 * too late.
 */
export function quality(link: Link): Quality {
  const tripMs = freshness(link).kind === "live" ? roundTripMs(link) : null;
  const allowedMs = 1000 * (link.state.value?.status.limits.max_command_age_s ?? 0);
  if (tripMs === null || allowedMs <= 0) return { grade: "none", bad: true, figure: null };
  const spreadMs = jitterMs(link) ?? 0;
  const used = (tripMs + spreadMs) / allowedMs;
  if (link.lost >= GOOD_LOSS) {
    const figure = { value: 100 * link.lost, unit: "%" } as const;
    return { grade: "lossy", bad: link.lost >= FAIR_LOSS, figure };
  }
  const bad = used >= FAIR;
  if (used < GOOD) return { grade: "good", bad, figure: { value: tripMs, unit: "ms" } };
  if (spreadMs > tripMs) return { grade: "uneven", bad, figure: { value: spreadMs, unit: "ms" } };
  return { grade: "slow", bad, figure: { value: tripMs, unit: "ms" } };
}
