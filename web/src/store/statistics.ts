/** Return the median and the 95th percentile minus the median; null without numbers. */
export function medianAndJitter(numbers: readonly number[]): {
  median: number | null;
  jitter: number | null;
} {
  if (numbers.length === 0) return { median: null, jitter: null };
  const sorted = [...numbers].sort((a, b) => a - b);
  const at = (share: number): number =>
    sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)] as number;
  return { median: at(0.5), jitter: at(0.95) - at(0.5) };
}
