// The one answer to "is what I see true now?"; all texts, colours and figures ask it.

import type { RobotState } from "../generated/wire";
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

/** Evaluate now; what depends on it follows the time that passes. */
export function freshness(link: Link): Freshness {
  void link.beat.value;
  const [connected, state, robot] = [link.connected.value, link.state.value, link.robot.value];
  const ageMs = link.ageMs();
  if (connected && robot !== null) {
    if (link.recording !== null) return { kind: "recorded", by: "page" };
    if (state !== null && ageMs <= STALE_MS)
      return state.source === "recording" ? { kind: "recorded", by: "bus" } : { kind: "live" };
  }
  if (link.isLoading()) return { kind: "starting" };
  if (!connected) return { kind: "offline", forMs: performance.now() - link.lostMs };
  return robot === null ? { kind: "no_robot" } : { kind: "silent", forMs: ageMs };
}

/** Whether figures are current: live, or at the cursor of a recording. */
export function isCurrent({ kind }: Freshness): boolean {
  return kind === "live" || kind === "recorded";
}

export function currentState(link: Link): RobotState | null {
  return isCurrent(freshness(link)) ? link.state.value : null;
}
