// Whether there is anybody to draw for.

/** Whether an element can be seen now: a tab that is not shown takes no room. */
export function isSeen(node) {
  return document.visibilityState === "visible" && node.offsetParent !== null;
}
