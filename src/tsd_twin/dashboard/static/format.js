// Number formatting: fixed decimals, a true minus sign, never "-0.00".

/** @param {number | null | undefined} value @param {number} decimals */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? `\u2212${text}` : text;
}

/** Whole degrees in (-180, 180]. @param {number | null | undefined} radians */
export function degrees(radians) {
  if (radians === null || radians === undefined) return "–";
  const turned = Math.round((radians * 180) / Math.PI) % 360;
  return fixed(turned > 180 ? turned - 360 : turned <= -180 ? turned + 360 : turned, 0);
}

/** Format a duration for reading. @param {number} seconds */
export function duration(seconds) {
  if (seconds < 60) return `${Math.floor(seconds)} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ${Math.floor(seconds % 60)} s`;
  return `${Math.floor(seconds / 3600)} h ${Math.floor((seconds % 3600) / 60)} min`;
}

/** Format a time in ms since 1970 as the time of day. @param {number} ms */
export function clock(ms) {
  return new Date(ms).toLocaleTimeString([], { timeStyle: "medium", hour12: false });
}
