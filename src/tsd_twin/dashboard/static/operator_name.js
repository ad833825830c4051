// Operator name, typed once and kept in the browser; shown on other operators' pages.

import { keep, recall } from "./memory.js";

const KEY = "tsd.name";
const MOST = 20;

/** Name typed on this or an earlier page, or "". */
export function typedName() {
  return permitted(recall(KEY) ?? "");
}

/** Store a name and return it as permitted on the bus. @param {string} text */
export function keepName(text) {
  const name = permitted(text);
  keep(KEY, name);
  return name;
}

/** Convert a name to unaccented letters, digits and dashes. @param {string} text */
export function permitted(text) {
  return text
    .normalize("NFKD")
    .replace(/\p{Mark}/gu, "")
    .toLowerCase()
    .replace(/[^a-z0-9_]+/g, "-")
    .replace(/^-+/, "")
    .slice(0, MOST)
    .replace(/-+$/, "");
}
