// Note for the next load of this page in this tab: that the robot was moving when it was left.

const KEY = "tsd.left_in_motion_ms";
const FRESH_MS = 20_000;

/** Note that the page is left while it drives the robot, which stops with it. */
export function noteMotion() {
  try {
    sessionStorage.setItem(KEY, String(Date.now()));
  } catch {
    // Without a memory, the events of the robot tell it.
  }
}

/** Return whether this page was left in motion a moment ago, and forget it. */
export function takeMotionNote() {
  try {
    const ageMs = Date.now() - Number(sessionStorage.getItem(KEY) ?? NaN);
    sessionStorage.removeItem(KEY);
    return ageMs < FRESH_MS;
  } catch {
    return false;
  }
}
