// Reasons that become notices; other parts of the page show the rest.

import type { Reason, RobotEvent } from "../generated/wire";
import type { Refusal } from "../store/permission";
import { refusalText, sentence } from "./reasons";
import { texts } from "./text";

export interface Told {
  text: string;
  /** Whether it explains the end of a motion, which page, server and robot may all report. */
  again: boolean;
  control: boolean;
}

/** Codes after which pushing a control again does not help: control must be taken first. */
const ABOUT_CONTROL = new Set([
  ...["take_control_first", "held_by", "driven_by", "reserved_for", "control_lost"],
  ...["has_control_now", "other_client", "lease_ended", "control_is_lost", "control_released"],
  ...["control_asked_for", "control_handed_over", "page_silent"],
]);
const PASSING = new Set(["connecting", "not_connected", "robot_silent"]);
/** Reasons that the deck shows, or that arrive as an event. */
const TOLD_ELSEWHERE = new Set([
  ...["stop_pressed", "stop_requested", "control_is_lost", "coming_to_rest", "reset_first"],
  "stopped_by_itself",
]);
const STANDING = new Set(["stopped", "stopping", "fault"]);
const BY_OPERATOR = new Set(["armed_by_operator", "disarmed_by_operator", "reset_by_operator"]);
const OF_ALL = new Set(["lease_taken_over", "lease_expired", "reservation_expired"]);

export const plain = (text: string): Told => ({ text, again: false, control: false });

export function isToldElsewhere({ code, params }: Reason): boolean {
  if (code === "mode_only") return STANDING.has(String(params?.["mode"]));
  return TOLD_ELSEWHERE.has(code);
}

/** Return the notice of a motion that has ended; `text` replaces the sentence of the reason. */
export function retry(reason: Reason, text = sentence(reason)): Told {
  if (ABOUT_CONTROL.has(reason.code)) return { text, again: false, control: true };
  return { text: texts().bar.news.pushAgain(text), again: true, control: false };
}

/** Return the notice of a motion ended by a refusal, or null if it is shown elsewhere. */
export function noticeOfRefusal(refusal: Refusal): Told | null {
  if (refusal.by === "robot") return isToldElsewhere(refusal.reason) ? null : retry(refusal.reason);
  const text = refusalText(refusal);
  return PASSING.has(refusal.code) ? retry({ code: refusal.code }, text) : plain(text);
}

/** Return the notice of an event; `you` says whether this page drives. */
export function noticeOf({ kind, why }: RobotEvent, you: boolean): Told {
  const { news } = texts().bar;
  const after = why.code === "mode_changed" && why.cause ? why.params?.["after"] : undefined;
  const cause = why.cause;
  if (!cause || (after !== "stopping" && after !== "disarmed"))
    return { text: sentence(why), again: false, control: kind === "lease" };
  const because = sentence(cause).replace(/\.$/, "");
  const text = after === "stopping" ? news.soStopped(because) : news.soOff(because);
  const control = ABOUT_CONTROL.has(cause.code);
  return you && after === "stopping" ? retry(cause, text) : { text, again: false, control };
}

/** Whether an event is worth a notice; the log of the Health tab has all events. */
export function isNotable({ kind, why }: RobotEvent, operator: string | undefined): boolean {
  if (kind === "id" || kind === "description" || kind === "consistency") return true;
  if (kind === "lease") return isNotableLease(why, operator);
  if (why.code !== "mode_changed" || !why.cause) return false;
  const ends = ["stopping", "disarmed"].includes(String(why.params?.["after"]));
  return ends && !BY_OPERATOR.has(why.cause.code);
}

function isNotableLease({ code, params = {} }: Reason, operator: string | undefined): boolean {
  if (operator === undefined || OF_ALL.has(code)) return true;
  // The bar asks the holder.
  if (code === "control_requested" && params["holder"] === operator) return false;
  const actor = code === "request_expired" ? params["holder"] : params["operator"];
  return actor !== operator; // Who acts knows it.
}
