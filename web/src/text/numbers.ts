// Figures: a minus of the right width, tabular, in the language of the page. A figure that is not
// known is an en dash.

import { language } from "./text";

const UNKNOWN = "–";
const formats = new Map<string, Intl.NumberFormat>();

/** Format a number with fixed decimals; `sign` also shows a plus. */
export function figure(value: number | null | undefined, decimals = 0, sign = false): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const key = `${language.value} ${decimals} ${sign}`;
  const format = formats.get(key) ?? newFormat(decimals, sign);
  formats.set(key, format);
  return format.format(value).replaceAll("-", "−");
}

function newFormat(decimals: number, sign: boolean): Intl.NumberFormat {
  return new Intl.NumberFormat(language.peek(), {
    minimumFractionDigits: decimals,
    maximumFractionDigits: decimals,
    signDisplay: sign ? "exceptZero" : "negative",
  });
}

export function degrees(radians: number | null | undefined): number | null {
  return radians === null || radians === undefined ? null : (radians * 180) / Math.PI;
}

/** Duration as 7 s, 2:05 or 1:02:05. */
export function duration(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds));
  if (whole < 60) return `${whole} s`;
  const two = (part: number) => String(part).padStart(2, "0");
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  return hours > 0
    ? `${hours}:${two(minutes)}:${two(whole % 60)}`
    : `${minutes}:${two(whole % 60)}`;
}
