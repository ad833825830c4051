// Sentences of reasons, as tsd_twin/messages/sentences.py makes them; a page shows operators by the
// names that they typed or logged in with.

import { TEMPLATES, TYPES, WORDS } from "./sentences.js";

const PART = /\[([^\]|]*)(?:\|([^\]]*))?\]/g;
const SLOT = /\{(\w+)(?::([+,]?)(?:\.(\d))?)?\}/g;
const FIRST_SLOT = /^\{(\w+)/;

/**
 * Return an operator without the number of their page. Pages without a name keep theirs.
 * @param {string} operator
 */
export function nameOf(operator) {
  return operator.replace(/^(?!web-)(.+)-[0-9a-f]{8}$/, "$1");
}

/**
 * Return the text of a reason as part of a sentence; an unknown code is shown as its words.
 * @param {Reason} reason @param {(operator: string) => string} [named]
 */
export function words(reason, named = nameOf) {
  return fill(reason, named).text;
}

/**
 * Return the text of a reason with a capital, unless an id comes first, and a full stop.
 * @param {Reason} reason @param {(operator: string) => string} [named]
 */
export function sentence(reason, named = nameOf) {
  const { text, keepsCase } = fill(reason, named);
  return `${keepsCase ? text : text.slice(0, 1).toUpperCase() + text.slice(1)}.`;
}

/**
 * @param {Reason} reason @param {(operator: string) => string} named
 * @returns {{ text: string, keepsCase: boolean }}
 */
function fill({ code, params = {}, cause }, named) {
  const types = TYPES[code];
  if (types === undefined) return { text: code.replaceAll("_", " "), keepsCase: false };
  const causes = cause ? fill(cause, named) : { text: "", keepsCase: false };
  const shown = (/** @type {string} */ name, sign = "", decimals = "") =>
    name === "cause" ? causes.text : show(params[name] ?? "", types[name], sign, decimals, named);
  const template = TEMPLATES[code].replace(PART, (_, inside, instead = "") => {
    const names = [...inside.matchAll(SLOT)].map(([, name]) => name);
    return names.every((name) => shown(name) !== "") ? inside : instead;
  });
  const text = template.replace(SLOT, (_, name, sign, decimals) => shown(name, sign, decimals));
  const first = FIRST_SLOT.exec(template)?.[1];
  if (first === undefined) return { text, keepsCase: false };
  const isId = types[first] === "operator" || types[first] === "name";
  return { text, keepsCase: first === "cause" ? causes.keepsCase : isId };
}

/**
 * @param {string | number} value @param {string | undefined} type @param {string} sign
 * @param {string} decimals @param {(operator: string) => string} named
 */
function show(value, type, sign, decimals, named) {
  if (typeof value === "string") return showText(value, type, named);
  if (sign === ",") return String(Math.round(value)).replace(/\B(?=(\d{3})+$)/g, ",");
  if (decimals === "") return String(value);
  return (value < 0 ? "-" : sign) + Math.abs(value).toFixed(Number(decimals));
}

/**
 * @param {string} value @param {string | undefined} type
 * @param {(operator: string) => string} named
 */
function showText(value, type, named) {
  if (type === "operator") return named(value);
  if (type === "servos") {
    const word = WORDS.servos[value.includes(", ") ? "several" : "one"];
    return value === "" ? "" : `${word} ${value}`;
  }
  const list = type === undefined ? undefined : WORDS[type];
  return list === undefined ? value : (list[value] ?? value.replaceAll("_", " "));
}

/** Codes that pushing a control again does not help with: control must be taken first. */
const ABOUT_CONTROL = new Set([
  ...["take_control_first", "held_by", "driven_by", "reserved_for", "control_lost"],
  ...["has_control_now", "other_client", "lease_ended", "control_is_lost", "control_released"],
  ...["control_asked_for", "control_handed_over", "page_silent"],
]);

/** Whether taking control comes before pushing again. @param {Reason} reason */
export function isAboutControl({ code }) {
  return ABOUT_CONTROL.has(code);
}

const ALREADY_NOTIFIED = new Set([
  ...["stop_pressed", "stop_requested", "control_is_lost", "coming_to_rest", "reset_first"],
]);
const STANDING = new Set(["stopped", "stopping", "fault"]);

/**
 * Whether the end of a motion is reported elsewhere: on the stop card, or by an event.
 * @param {Reason} reason
 */
export function isToldElsewhere({ code, params }) {
  if (code === "mode_only") return STANDING.has(String(params?.mode));
  return ALREADY_NOTIFIED.has(code);
}

/**
 * @typedef {{ text: string, again: boolean, key: string }} Notice Text, whether it explains why a
 *   motion ended and how to continue, and the key that identifies repeats.
 */

/** @param {string} text @param {string} [key] @returns {Notice} */
export function notice(text, key = text) {
  return { text, again: false, key };
}

/**
 * Return a key that is equal for equal reasons: code, free texts and operators.
 * @param {Reason} reason @returns {string}
 */
export function keyOf({ code, params = {}, cause }) {
  const texts = Object.values(params).filter((value) => typeof value === "string");
  return [code, ...texts, ...(cause ? [keyOf(cause)] : [])].join(" ");
}

/**
 * Return the notice of a motion that has ended; without control, pushing again does not help.
 * @param {Reason} reason @param {string} [text] Its sentence.
 * @returns {Notice}
 */
export function retryNotice(reason, text = sentence(reason)) {
  if (isAboutControl(reason)) return notice(text, keyOf(reason));
  return { text: `${text} Let go, then push again.`, again: true, key: keyOf(reason) };
}

/**
 * Return the notice of an event. If the robot is stopping, it gives the reason and an action.
 * @param {RobotEvent} event @param {boolean} you Whether this page drives.
 * @returns {Notice}
 */
export function noticeOf({ why }, you) {
  const cause = stoppingCause(why);
  if (cause === null) return notice(sentence(why), keyOf(why));
  const text = sentence(cause).replace(/\.$/, ", so the robot stopped.");
  return you ? retryNotice(cause, text) : notice(text, keyOf(cause));
}

/** @param {Reason} why */
function stoppingCause({ code, params, cause }) {
  return code === "mode_changed" && params?.after === "stopping" ? (cause ?? null) : null;
}

/**
 * Return why a robot was stopped, as a sentence. @param {Reason | null} stop
 * @param {string | undefined} operator The operator of this page.
 */
export function stopReason(stop, operator) {
  if (stop === null) return "No reason given.";
  const by = stop.code === "stop_requested" ? stop.params?.by : undefined;
  if (by === undefined || stop.cause) return sentence(stop);
  return by === operator ? "You pressed STOP." : `${nameOf(String(by))} stopped the robot.`;
}

/**
 * Whether to show an event as a notice; the log of the Health tab contains all events.
 * @param {RobotEvent} event @param {string | undefined} operator
 */
export function isNotable({ kind, why }, operator) {
  if (kind === "id" || kind === "description") return true;
  if (kind === "lease") return isNotableLease(why, operator);
  if (why.code !== "mode_changed" || !why.cause) return false;
  const ends = ["stopping", "disarmed"].includes(String(why.params?.after));
  return ends && !BY_OPERATOR.has(why.cause.code);
}

const BY_OPERATOR = new Set(["armed_by_operator", "disarmed_by_operator", "reset_by_operator"]);
const OF_ALL = new Set(["lease_taken_over", "lease_expired", "reservation_expired"]);

/** @param {Reason} why @param {string | undefined} operator */
function isNotableLease({ code, params = {} }, operator) {
  if (operator === undefined || OF_ALL.has(code)) return true;
  if (code === "control_requested" && params.holder === operator) return false; // Notified already.
  const actor = code === "request_expired" ? params.holder : params.operator;
  return actor !== operator; // Who acts knows it.
}
