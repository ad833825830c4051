// Permission checks: each returns the reason for a refusal as a sentence, or null. The robot status
// provides the robot's reasons; the page adds link, role and lack of control.

import { assertDefined } from "./link.js";
import { sentence } from "./reasons.js";

const MOVABLE = new Set(["ready", "driving"]);
export const LATCHED = new Set(["stopped", "fault"]);

/** Whether this page shows a recording, so its states are not from live robots. */
export const SHOWS_RECORDING = (globalThis.window?.tsd?.recording ?? null) !== null;
export const READ_ONLY = SHOWS_RECORDING
  ? "This is a recording: press L for the live robots. STOP stops those."
  : "You watch: a viewer does not drive.";
const REPLAY = "This is a recording: choose a live robot. STOP stops all of those.";

/** Whether a recording is shown: the page's, or a replay on the bus. @param {Link} link */
export function showsRecording(link) {
  return SHOWS_RECORDING || link.state?.source === "recording";
}

/** @param {Link} link */
export function isReadOnly(link) {
  return link.welcome?.role === "viewer";
}

/** Return why no data arrives from the dashboard. @param {Link} link */
export function notConnected(link) {
  return link.isLoading() ? "Connecting to the dashboard" : "No connection to the dashboard";
}

/**
 * @typedef {{ why: Reason, text: string }} Refusal A reason with its sentence; the codes of the page
 *   are its own.
 */

/** @param {string} code @param {string} text @returns {Refusal} */
export function ofPage(code, text) {
  return { why: { code }, text };
}

/** @param {Reason} why @returns {Refusal} */
function ofRobot(why) {
  return { why, text: sentence(why) };
}

/** @param {Link} link @returns {Refusal | null} */
function notAllowed(link) {
  if (!link.connected) return ofPage("not_connected", `${notConnected(link)}.`);
  if (link.robot === null) return ofPage("no_robot", "No robot is on the bus.");
  if (link.isStale()) return ofPage("gone_silent", "The robot has gone silent.");
  if (isReadOnly(link)) return ofPage("watches", READ_ONLY);
  return showsRecording(link) ? ofPage("replay", REPLAY) : null;
}

/** Null also for robots that send no reasons. @param {Link} link @param {string} request */
function robotRefusal(link, request) {
  const why = assertDefined(link.state).status.refusals?.why?.[request];
  return why ? ofRobot(why) : null;
}

/** For what requires control. @param {Link} link @param {string} request */
function notNow(link, request) {
  const refusal = notAllowed(link);
  if (refusal !== null) return refusal;
  if (assertDefined(link.state).has_control) return robotRefusal(link, request);
  return robotRefusal(link, "no_lease") ?? ofRobot({ code: "take_control_first" });
}

/** @param {Link} link */
export function whyNotDrive(link) {
  const refusal = notNow(link, "drive");
  if (refusal !== null) return refusal;
  // A control held while the robot stops must be released before it acts again.
  const mode = assertDefined(link.state).status.mode;
  return MOVABLE.has(mode) ? null : ofRobot({ code: "mode_only", params: { mode } });
}

/** @param {Link} link */
export function whyNotPlan(link) {
  const refusal = notNow(link, "disarm");
  if (refusal !== null) return refusal;
  // A path can be planned before the robot is armed; a latched stop ends it.
  return LATCHED.has(assertDefined(link.state).status.mode) ? whyNotDrive(link) : null;
}

/** @param {Refusal | null} refusal */
export function textOf(refusal) {
  return refusal?.text ?? null;
}

/** @param {Link} link */
export function driveBlockedReason(link) {
  return textOf(whyNotDrive(link));
}

/** @param {Link} link */
export function acquireBlockedReason(link) {
  const refusal = notAllowed(link);
  if (refusal !== null) return refusal.text;
  const { holder, reserved_for: reserved } = assertDefined(link.state).status.lease;
  // The holder can release it, and others can request it.
  if (holder !== null || reserved === link.welcome?.operator) return null;
  return textOf(robotRefusal(link, "lease"));
}

/** @param {Link} link */
export function stopBlockedReason(link) {
  const may = link.welcome?.may_stop ?? true;
  return may ? null : "You watch: a viewer neither drives nor stops.";
}

/** @param {Link} link */
export function armBlockedReason(link) {
  return textOf(notNow(link, "arm"));
}

/** @param {Link} link */
export function wheelSpeedBlockedReason(link) {
  return textOf(notNow(link, "speed"));
}

/** @param {Link} link */
export function planBlockedReason(link) {
  return textOf(whyNotPlan(link));
}

/** @param {Link} link */
export function disarmBlockedReason(link) {
  return textOf(notNow(link, "disarm"));
}

/** @param {Link} link */
export function resetBlockedReason(link) {
  return textOf(notNow(link, "reset"));
}
