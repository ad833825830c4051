// Permission checks: each returns the reason of a refusal as a sentence, or null. The robot's status
// has the reasons of the robot; the page adds the link, the role and that it is not in control.

import { sentence } from "./format.js";
import { known } from "./link.js";

const MOVABLE = new Set(["ready", "driving"]);
export const LATCHED = new Set(["stopped", "fault"]);

/** Whether this page shows a recording, whose states say nothing of the live robots. */
export const SHOWS_RECORDING = (globalThis.window?.tsd?.recording ?? null) !== null;
export const WATCHES = SHOWS_RECORDING
  ? "This is a recording: press L for the live robots. STOP stops those."
  : "You watch: a viewer does not drive.";
const REPLAY = "This is a recording: choose a live robot. STOP stops all of those.";

/** Whether a recording is in view: that of the page, or a replay on the bus. @param {Link} link */
export function showsRecording(link) {
  return SHOWS_RECORDING || link.state?.source === "recording";
}

/** @param {Link} link */
export function watches(link) {
  return link.welcome?.role === "viewer";
}

/** Return why nothing comes from the dashboard. @param {Link} link */
export function notConnected(link) {
  return link.isLoading() ? "Connecting to the dashboard" : "No connection to the dashboard";
}

/** @param {Link} link */
function notAllowed(link) {
  if (!link.connected) return `${notConnected(link)}.`;
  if (link.robot === null) return "No robot is on the bus.";
  if (link.isStale()) return "The robot has gone silent.";
  if (watches(link)) return WATCHES;
  return showsRecording(link) ? REPLAY : null;
}

/** Null also for robots that send no reasons. @param {Link} link @param {keyof Refusals} request */
function robotRefusal(link, request) {
  const reason = known(link.state).status.refusals?.[request];
  return reason ? sentence(reason) : null;
}

/** For what requires control. @param {Link} link @param {keyof Refusals} request */
function notNow(link, request) {
  const reason = notAllowed(link);
  if (reason !== null) return reason;
  if (known(link.state).you) return robotRefusal(link, request);
  return robotRefusal(link, "without_lease") ?? "Take control first.";
}

/** @param {Link} link */
export function notDrive(link) {
  const reason = notNow(link, "drive");
  if (reason !== null) return reason;
  // A control that is held while the robot comes to rest moves it only when it is used anew.
  const mode = known(link.state).status.mode;
  return MOVABLE.has(mode) ? null : sentence(`the robot is ${mode}`);
}

/** @param {Link} link */
export function notTake(link) {
  const reason = notAllowed(link);
  if (reason !== null) return reason;
  const { holder, reserved_for: reserved } = known(link.state).status.lease;
  // Who is in control can release it, and others can ask the holder.
  if (holder !== null || reserved === link.welcome?.operator) return null;
  return robotRefusal(link, "lease");
}

/** @param {Link} link */
export function notStop(link) {
  const may = link.welcome?.may_stop ?? true;
  return may ? null : "You watch: a viewer neither drives nor stops.";
}

/** @param {Link} link */
export function notArm(link) {
  return notNow(link, "arm");
}

/** @param {Link} link */
export function notSetWheelSpeed(link) {
  return notNow(link, "speed");
}

/** @param {Link} link */
export function notPlan(link) {
  const reason = notNow(link, "disarm");
  if (reason !== null) return reason;
  // A path can be planned before the robot is armed; a latched stop ends it.
  return LATCHED.has(known(link.state).status.mode) ? notDrive(link) : null;
}

/** @param {Link} link */
export function notDisarm(link) {
  return notNow(link, "disarm");
}

/** @param {Link} link */
export function notReset(link) {
  return notNow(link, "reset");
}
