// Permission checks: each returns the reason of a refusal as a sentence, or null. What needs control
// only, as to disarm and to reset, asks `notHolder`.

import { sentence } from "./format.js";
import { known } from "./link.js";

const MOVABLE = new Set(["ready", "driving"]);
const LATCHED = new Set(["stopped", "fault"]);
/** @type {Record<string, string>} */
const SAID = {
  disarmed: "the robot is disarmed: arm it first",
  arming: "the robot is still arming",
  stopping: "the robot is coming to rest",
  stopped: "the robot is stopped: reset the stop first",
  fault: "the robot has a fault: reset it first",
};

export const WATCHES = "You watch: a viewer does not drive.";

/** @param {Link} link */
export function watches(link) {
  return link.welcome?.role === "viewer";
}

/** @param {Link} link */
function notAllowed(link) {
  if (!link.connected) return "No connection to the dashboard.";
  if (link.robot === null) return "No robot is on the bus.";
  if (link.isStale()) return "The robot has gone silent.";
  return watches(link) ? WATCHES : null;
}

/** @param {Link} link */
export function notHolder(link) {
  return notAllowed(link) ?? notHeld(known(link.state));
}

/** @param {RobotState} state */
function notHeld({ you, status: { lease } }) {
  if (you) return null;
  if (lease.holder === null) return "The lease is free: take control first.";
  return `${lease.holder} drives: ask for control.`;
}

/** @param {Link} link */
export function notTake(link) {
  const kept = link.state?.status.lease.reserved_for ?? null;
  const free = kept === null || kept === link.welcome?.operator;
  return notAllowed(link) ?? (free ? null : `Control is kept for ${kept}, for a moment.`);
}

/** @param {Link} link */
export function notStop(link) {
  const may = link.welcome?.may_stop ?? true;
  return may ? null : "You watch: a viewer neither drives nor stops.";
}

/** @param {Link} link */
export function notDrive(link) {
  const mode = link.state?.status.mode ?? "";
  const reason = sentence(SAID[mode] ?? `the robot is ${mode}`);
  return notHolder(link) ?? (MOVABLE.has(mode) ? null : reason);
}

/** @param {Link} link */
export function notArm(link) {
  const mode = link.state?.status.mode ?? "";
  const reason = mode === "disarmed" ? null : `The robot is ${mode} already.`;
  return notPrepare(link) ?? reason;
}

/** For what is set or planned, but does not move the robot by itself. @param {Link} link */
export function notPrepare(link) {
  const mode = link.state?.status.mode ?? "";
  return notHolder(link) ?? (LATCHED.has(mode) ? sentence(SAID[mode]) : null);
}
