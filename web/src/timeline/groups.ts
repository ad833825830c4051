// Labels on a lane that never overlap: those that would are merged into one with a count.

const GAP_PX = 4;
const LEAST_PX = 72;

export interface Group<T> {
  items: readonly T[];
  leftPx: number;
  widthPx: number;
}

/**
 * Place labels on a lane of `roomPx`, each from `atPx` of its item to the right. At the end they are
 * cut off, or moved to the left if little would remain. `items` are sorted by position.
 */
export function grouped<T>(
  items: readonly T[],
  roomPx: number,
  atPx: (item: T) => number,
  labelPx: (items: readonly T[]) => number,
): Group<T>[] {
  const place = (merged: readonly T[]): Group<T> => {
    const wantedPx = labelPx(merged);
    const lastPx = Math.max(0, roomPx - Math.min(wantedPx, LEAST_PX));
    const leftPx = Math.max(0, Math.min(atPx(merged[0] as T), lastPx));
    const widthPx = Math.min(wantedPx, roomPx - leftPx);
    return { items: merged, leftPx, widthPx };
  };
  const groups: Group<T>[] = [];
  for (const item of items) {
    let next = place([item]);
    for (let last = groups.at(-1); last && overlap(last, next); last = groups.at(-1)) {
      groups.pop();
      next = place([...last.items, ...next.items]);
    }
    groups.push(next);
  }
  return groups;
}

function overlap<T>(left: Group<T>, right: Group<T>): boolean {
  return left.leftPx + left.widthPx + GAP_PX > right.leftPx;
}

/** Width of a text of 12 px, estimated from above; labels are also cut off at it. */
export function textPx(text: string): number {
  let px = 0;
  for (const letter of text) px += letter < "\u0300" ? 7.5 : 13;
  return px;
}

export interface Span<T> {
  value: T;
  /** Shares of the time for which there are samples. */
  from: number;
  to: number;
}

/** Join equal samples at even times from 0 to 1 to spans; borders are midway between samples. */
export function spans<T>(samples: readonly T[]): Span<T>[] {
  const joined: Span<T>[] = [];
  const border = (i: number) =>
    Math.max(0, Math.min(1, (i - 0.5) / Math.max(1, samples.length - 1)));
  samples.forEach((value, i) => {
    const last = joined.at(-1);
    if (last && last.value === value) last.to = border(i + 1);
    else joined.push({ value, from: border(i), to: border(i + 1) });
  });
  return joined;
}

/**
 * Path through samples in a square of 1, the greatest of which is at the top. It is interrupted
 * where there are none.
 */
export function linePath(samples: readonly (number | null)[]): string {
  const most = Math.max(0.1, ...samples.map((value) => value ?? 0));
  const last = Math.max(1, samples.length - 1);
  return samples
    .map((value, i) => {
      if (value === null) return "";
      const command = (samples[i - 1] ?? null) === null ? "M" : "L";
      return `${command}${(i / last).toFixed(4)} ${(1 - value / most).toFixed(3)}`;
    })
    .join("");
}
