// Numbers as they are shown: fixed decimals, a true minus sign, never "-0.00".

/** @param {number | null | undefined} value @param {number} decimals */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? `\u2212${text}` : text;
}

/** Whole degrees, in (-180, 180]. @param {number | null | undefined} radians */
export function degrees(radians) {
  if (radians === null || radians === undefined) return "–";
  const turned = Math.round((radians * 180) / Math.PI) % 360;
  return fixed(turned > 180 ? turned - 360 : turned <= -180 ? turned + 360 : turned, 0);
}

/** Return seconds as a person says them. @param {number} seconds */
export function duration(seconds) {
  if (seconds < 60) return `${Math.floor(seconds)} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ${Math.floor(seconds % 60)} s`;
  return `${Math.floor(seconds / 3600)} h ${Math.floor((seconds % 3600) / 60)} min`;
}

/** Return the time of day of a moment, in ms since 1970. @param {number} ms */
export function clock(ms) {
  return new Date(ms).toLocaleTimeString([], { timeStyle: "medium", hour12: false });
}

// A text that begins with the id of an operator; ids stay as they are.
const ID_FIRST =
  /^[a-z0-9_-]+ (has (control|given)|drives|asks|is asked|keeps|does not|took|sent|stopped)\b/;

/** Return a text of a robot or the server with a capital and a full stop. @param {string} text */
export function sentence(text) {
  const named = withNames(text);
  const first = ID_FIRST.test(named) ? named[0] : named[0].toUpperCase();
  return `${first}${named.slice(1)}.`;
}

/**
 * Return a text in which operators have the names that they typed or logged in with, without the
 * numbers of their pages. Pages without a name keep theirs: `web-8c30fedb`.
 * @param {string} text
 */
export function withNames(text) {
  return text.replace(/\b(?!web-)([a-z0-9_][a-z0-9_-]*?)-[0-9a-f]{8}\b/g, "$1");
}

const AGAIN = "Let go, then push again.";

/** Whether a notice tells why a motion has ended, and how to go on. @param {string} text */
export function isAgain(text) {
  return text.endsWith(AGAIN);
}

/**
 * Return the notice of a motion that has ended; without control, pushing again does not help.
 * @param {string} why A sentence.
 */
export function againNotice(why) {
  return /\bcontrol\b/i.test(why) ? why : `${why} ${AGAIN}`;
}

/**
 * Return the notice of an event: of a robot that comes to rest, why it does, and what to do.
 * @param {RobotEvent} event @param {boolean} you Whether this page drives.
 */
export function noticeOf({ kind, text }, you) {
  const why = kind === "mode" ? /to stopping: (.+?)\.?$/.exec(text)?.[1] : undefined;
  if (why === undefined) return withNames(text);
  const said = sentence(`${why}, so the robot stopped`);
  return you ? againNotice(said) : said;
}

/**
 * Return why a robot was stopped, as a sentence. @param {string} reason
 * @param {string | undefined} operator The operator of this page.
 */
export function stopReason(reason, operator) {
  const by = /^software stop by (.+)$/.exec(reason)?.[1];
  if (by === undefined) return sentence(reason || "no reason given");
  return by === operator ? "You pressed STOP." : sentence(`${by} stopped the robot`);
}
