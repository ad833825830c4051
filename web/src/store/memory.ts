// Values kept in the browser. Without storage, as in some private windows, nothing is kept.

import { effect, type Signal, signal } from "@preact/signals";

/** Checks a stored value, which may be from an older page. */
type Check<T> = (stored: unknown) => stored is T;

/** Signal kept under `key`. */
export function remembered<T>(key: string, initial: T, accepts: Check<T>): Signal<T> {
  const value = signal(recall(key, accepts) ?? initial);
  let first = true;
  effect(() => {
    const latest = value.value;
    if (!first) keep(key, latest);
    first = false;
  });
  return value;
}

export const isText = (stored: unknown): stored is string => typeof stored === "string";
export const isFlag = (stored: unknown): stored is boolean => typeof stored === "boolean";
export const isObject = <T extends object>(stored: unknown): stored is T =>
  typeof stored === "object" && stored !== null;

export function isOneOf<T extends string>(choices: readonly T[]) {
  return (stored: unknown): stored is T => choices.includes(stored as T);
}

type Kept = "localStorage" | "sessionStorage";

export function recall<T>(key: string, accepts: Check<T>, where: Kept = "localStorage"): T | null {
  try {
    const stored: unknown = JSON.parse(window[where].getItem(key) ?? "null");
    return accepts(stored) ? stored : null;
  } catch {
    return null;
  }
}

export function keep(key: string, value: unknown, where: Kept = "localStorage"): void {
  try {
    window[where].setItem(key, JSON.stringify(value));
  } catch {
    // Not kept for the next page.
  }
}
