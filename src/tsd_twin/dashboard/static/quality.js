// How good the link is, measured against the age up to which commands count.

const GOOD = 0.4;
const FAIR = 0.8;
const FEW_LOST = 0.05;
const MANY_LOST = 0.2;

/**
 * Return "good", "fair", "poor" or "none", and the share of the allowed age that a late command
 * uses up: the round trip and its jitter. A command is that old when it arrives, or up to a state's
 * period, 50 ms, older; so beyond four fifths some come too late.
 */
export function quality({ tripMs, jitterMs, lost, allowedMs }) {
  if (tripMs === null || !(allowedMs > 0)) return { grade: "none", used: null };
  const used = (tripMs + (jitterMs ?? 0)) / allowedMs;
  if (used < GOOD && lost < FEW_LOST) return { grade: "good", used };
  return { grade: used < FAIR && lost < MANY_LOST ? "fair" : "poor", used };
}

/** Return the median of some numbers, and how much more one in twenty is; null without any. */
export function spread(numbers) {
  if (numbers.length === 0) return { middle: null, jitter: null };
  const sorted = [...numbers].sort((a, b) => a - b);
  const at = (share) => sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)];
  return { middle: at(0.5), jitter: at(0.95) - at(0.5) };
}
