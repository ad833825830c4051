// What this page may do now: each question returns the reason for "no", or null. The robot states
// its own reasons in its status; the page adds link, role and lack of control.

import type { Table } from "../generated/texts";
import type { Reason } from "../generated/wire";
import { freshness } from "./freshness";
import type { Link } from "./link";

const MOVABLE = ["ready", "driving"];

/** Reasons of the page; the table of texts has their sentences. */
export type PageCode = keyof Table["common"]["refusals"];

export type Refusal = { by: "page"; code: PageCode } | { by: "robot"; reason: Reason };

const ofPage = (code: PageCode): Refusal => ({ by: "page", code });
const ofRobot = (reason: Reason): Refusal => ({ by: "robot", reason });

/** Code of a refusal: two refusals with one code have the same cause. */
export function codeOf(refusal: Refusal): string {
  return refusal.by === "page" ? refusal.code : refusal.reason.code;
}

/** Whether a refusal still holds, given what the same check returns now. */
export function stillHolds(refusal: Refusal, now: Refusal | null): boolean {
  return now !== null && codeOf(now) === codeOf(refusal);
}

const modeOf = (link: Link): string => link.state.value?.status.mode ?? "";
export const isLatched = (link: Link): boolean => ["stopped", "fault"].includes(modeOf(link));
export const isMoving = (link: Link): boolean => ["driving", "stopping"].includes(modeOf(link));

/** Reasons while no state is current; viewers may not drive at any time. */
const UNKNOWN = {
  starting: "connecting",
  offline: "not_connected",
  no_robot: "no_robot",
  silent: "robot_silent",
} as const;

function notAllowed(link: Link): Refusal | null {
  const fresh = freshness(link);
  if (fresh.kind === "recorded")
    return ofPage(fresh.by === "page" ? "recording_shown" : "replay_shown");
  const isViewer = link.welcome.value?.role === "viewer";
  if (isViewer && (fresh.kind === "live" || fresh.kind === "silent")) return ofPage("viewer_only");
  return fresh.kind === "live" ? null : ofPage(UNKNOWN[fresh.kind]);
}

/** Null also for robots that send no reasons. */
function robotRefusal(link: Link, request: string): Refusal | null {
  const reason = link.state.value?.status.refusals?.why?.[request];
  return reason ? ofRobot(reason) : null;
}

type Controlled = "arm" | "disarm" | "drive" | "reset" | "speed";

/** For what requires control. */
export function whyNot(link: Link, request: Controlled): Refusal | null {
  const refusal = notAllowed(link);
  if (refusal !== null) return refusal;
  if (link.state.value?.has_control) return robotRefusal(link, request);
  return robotRefusal(link, "no_lease") ?? ofRobot({ code: "take_control_first" });
}

export function whyNotDrive(link: Link): Refusal | null {
  const refusal = whyNot(link, "drive");
  if (refusal !== null) return refusal;
  // A control held while the robot stops must be released before it acts again.
  const mode = modeOf(link);
  return MOVABLE.includes(mode) ? null : ofRobot({ code: "mode_only", params: { mode } });
}

/** A path can be planned before the robot is armed; a latched stop ends it. */
export function whyNotPlan(link: Link): Refusal | null {
  return whyNot(link, "disarm") ?? (isLatched(link) ? whyNotDrive(link) : null);
}

/** The holder can be asked, so a held lease does not matter. */
export function whyNotTakeControl(link: Link): Refusal | null {
  const refusal = notAllowed(link);
  if (refusal !== null) return refusal;
  const lease = link.state.value?.status.lease;
  if (!lease || lease.holder !== null) return null;
  if (lease.reserved_for === link.welcome.value?.operator) return null;
  return robotRefusal(link, "lease");
}

/** STOP is for everybody, except viewers of a dashboard that forbids it. */
export function whyNotStop(link: Link): Refusal | null {
  return (link.welcome.value?.may_stop ?? true) ? null : ofPage("viewer_cannot_stop");
}
