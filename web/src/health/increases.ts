// Recent increase of counters, since a counter alone only shows that something happened once.

export const RECENT_S = 10;

export class Increases {
  #counts = new Map<string, { ms: number; count: number }[]>();

  /** Note a counter now, and return its increase in the last seconds; after a restart, zero. */
  of(name: string, count: number): number {
    const ms = performance.now();
    const before = this.#counts.get(name) ?? [];
    const kept = before.filter((each) => ms - each.ms <= 1000 * RECENT_S && each.count <= count);
    this.#counts.set(name, [...kept, { ms, count }]);
    return count - (kept[0]?.count ?? count);
  }
}
