// What is said about a way.

import { fixed } from "./format.js";

const OVER = new Set(["arrived", "ended"]);
const SAID = {
  to: "Click on the floor, drag to say where to look",
  draw: "Draw on the floor",
};

/** Return whether it has come to its end, good or bad. */
export function isOver(route) {
  return OVER.has(route?.phase);
}

/** Return what there is to say about a way, or of none what there is to do. */
export function wordsOf(route, mode) {
  switch (route?.phase) {
    case "planning":
      return "Planning…";
    case "planned":
      return `${fixed(route.length_m, 2)} m, ${fixed(route.time_s, 1)} s`;
    case "going":
      return `${fixed(route.done_m, 2)} of ${fixed(route.length_m, 2)} m`;
    case "arrived":
      return `Arrived, ${fixed(route.off_mm, 0)} mm off`;
    case "ended":
      return `Ended: ${route.reason}`;
  }
  return SAID[mode] ?? "";
}
