// Remembers, for the next load in this tab, that the robot was moving when the page was left.

const KEY = "tsd.left_in_motion_ms";
const FRESH_MS = 20_000;

/** Remember that the page was left while driving, which stops the robot. */
export function noteMotion() {
  try {
    sessionStorage.setItem(KEY, String(Date.now()));
  } catch {
    // Without storage, the robot's events show it.
  }
}

/** Return whether this page was recently left in motion, and clear the flag. */
export function takeMotionNote() {
  try {
    const ageMs = Date.now() - Number(sessionStorage.getItem(KEY) ?? NaN);
    sessionStorage.removeItem(KEY);
    return ageMs < FRESH_MS;
  } catch {
    return false;
  }
}
