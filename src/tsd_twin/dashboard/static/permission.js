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
function notConnected(link) {
  if (!link.connected) return "No connection to the dashboard.";
  if (link.robot === null) return "No robot is on the bus.";
  if (link.isStale()) return "The robot has gone silent.";
  return null;
}

/** @param {Link} link */
function notAllowed(link) {
  return notConnected(link) ?? (watches(link) ? WATCHES : null);
}

/** @param {Link} link */
export function notHolder(link) {
  const reason = notAllowed(link);
  if (reason !== null) return reason;
  if (known(link.state).you) return null;
  const holder = known(link.state).status.lease.holder;
  return holder === null
    ? "The lease is free: take control first."
    : `${holder} drives: ask for control.`;
}

/** @param {Link} link */
export function notDrive(link) {
  const reason = notHolder(link);
  if (reason !== null) return reason;
  const mode = known(link.state).status.mode;
  return MOVABLE.has(mode) ? null : sentence(SAID[mode] ?? `the robot is ${mode}`);
}

/** @param {Link} link */
export function notTake(link) {
  const reason = notAllowed(link);
  if (reason !== null) return reason;
  const { reserved_for: kept } = known(link.state).status.lease;
  const free = (kept ?? null) === null || kept === link.welcome?.operator;
  return free ? null : `Control is kept for ${kept}, for a moment.`;
}

/** @param {Link} link */
export function notStop(link) {
  const may = link.welcome?.may_stop ?? true;
  return may ? null : "You watch: a viewer neither drives nor stops.";
}

/** @param {Link} link */
export function notArm(link) {
  const reason = notHolder(link);
  if (reason !== null) return reason;
  const mode = known(link.state).status.mode;
  if (LATCHED.has(mode)) return sentence(SAID[mode]);
  return mode === "disarmed" ? null : `The robot is ${mode} already.`;
}

/** For what is set or planned, but does not move the robot by itself. @param {Link} link */
export function notPrepare(link) {
  const reason = notHolder(link);
  if (reason !== null) return reason;
  const mode = known(link.state).status.mode;
  return LATCHED.has(mode) ? sentence(SAID[mode]) : null;
}
