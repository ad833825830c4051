// Buffer of plotted values: 10 min at 20 Hz, in preallocated typed arrays.

const SAMPLES = 600 * 20;

export class PlotBuffer {
  length = 0;
  #columns = new Map<string, Float64Array>();
  readonly #times: Float64Array;
  readonly #samples: number;

  /** The oldest samples are dropped in batches of `spare`. */
  constructor(samples = SAMPLES, spare = samples / 8) {
    this.#samples = samples;
    this.#times = new Float64Array(samples + spare);
  }

  /** Times in seconds, oldest first; a view valid until the next sample. */
  get times(): Float64Array {
    return this.#times.subarray(0, this.length);
  }

  get newestS(): number {
    return this.#times[this.length - 1] ?? NaN;
  }

  /** Values matching the times, NaN where missing. */
  values(name: string): Float64Array {
    const column = this.#columns.get(name);
    return column?.subarray(0, this.length) ?? new Float64Array(this.length).fill(NaN);
  }

  /** Keep these columns, add new ones and drop all others. */
  select(names: readonly string[]): void {
    const column = (name: string) =>
      this.#columns.get(name) ?? new Float64Array(this.#times.length).fill(NaN);
    this.#columns = new Map(names.map((name) => [name, column(name)]));
  }

  clear(): void {
    this.length = 0;
  }

  /** Add a sample; ignored unless newer than the last. */
  add(timeS: number, read: (name: string) => number): void {
    if (timeS <= this.newestS) return;
    if (this.length === this.#times.length) {
      const dropped = this.length - this.#samples;
      for (const each of [this.#times, ...this.#columns.values()]) each.copyWithin(0, dropped);
      this.length = this.#samples;
    }
    this.#times[this.length] = timeS;
    for (const [name, column] of this.#columns) column[this.length] = read(name);
    this.length += 1;
  }

  /** Return the index range [from, to) of the samples in a time span, both ends included. */
  places(fromS: number, toS: number): [number, number] {
    const from = this.times.findIndex((time) => time >= fromS);
    return [from < 0 ? this.length : from, this.times.findLastIndex((time) => time <= toS) + 1];
  }

  /** Return a time span as CSV: robot time in seconds, rounded to 1 µs, and a column per field. */
  csv(fields: readonly { name: string; unit: string }[], fromS: number, toS: number): string {
    const heads = fields.map(({ name, unit }) => `${name} [${unit}]`).join();
    const lines = [`robot_time [s],${heads}`.replaceAll("°", "deg").replaceAll("µ", "u")];
    const columns = fields.map(({ name }) => this.values(name));
    const [from, to] = this.places(fromS, toS);
    for (let i = from; i < to; i += 1) {
      const numbers = [Number(this.#times[i]!.toFixed(6)), ...columns.map((each) => each[i]!)];
      lines.push(numbers.join().replaceAll("NaN", "nan"));
    }
    return `${lines.join("\n")}\n`;
  }
}
