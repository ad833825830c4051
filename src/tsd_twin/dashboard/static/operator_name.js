// Name of the operator, typed once and kept in the browser; the pages of others show it.

import { keep, recall } from "./memory.js";

const KEY = "tsd.name";
const MOST = 20;

/** The name that was typed on this or an earlier page; empty without one. */
export function typedName() {
  return permitted(recall(KEY) ?? "");
}

/** Keep a name, and return it as the bus permits it. @param {string} text */
export function keepName(text) {
  const name = permitted(text);
  keep(KEY, name);
  return name;
}

/** Return a name in letters without accents, digits and dashes. @param {string} text */
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
