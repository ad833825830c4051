// Buffer of plotted values: 10 min at 20 Hz, in preallocated typed arrays.

const SAMPLES = 600 * 20;
const SPARE = SAMPLES / 8; // The oldest samples are dropped in batches of this size.

export class PlotBuffer {
  constructor(samples = SAMPLES, spare = SPARE) {
    this._samples = samples;
    this._times = new Float64Array(samples + spare);
    /** @type {Map<string, Float64Array>} */
    this._columns = new Map();
    this.length = 0;
    this.generation = 0; // Incremented on each clear.
  }

  /** Times in seconds, oldest first; a view valid until the next sample. */
  get times() {
    return this._times.subarray(0, this.length);
  }

  get newestS() {
    return this.length > 0 ? this._times[this.length - 1] : NaN;
  }

  /** Values matching the times, NaN where missing. @param {string} name */
  values(name) {
    return (
      this._columns.get(name)?.subarray(0, this.length) ?? new Float64Array(this.length).fill(NaN)
    );
  }

  /** Keep these columns, add new ones and drop all others. @param {Iterable<string>} names */
  select(names) {
    const before = this._columns;
    const made = () => new Float64Array(this._times.length).fill(NaN);
    this._columns = new Map([...names].map((name) => [name, before.get(name) ?? made()]));
  }

  clear() {
    this.length = 0;
    this.generation += 1;
  }

  /**
   * Add a sample; ignored unless newer than the last.
   * @param {number} timeS @param {(name: string) => number} read
   */
  add(timeS, read) {
    if (timeS <= this.newestS) return;
    if (this.length === this._times.length) this._drop(this.length - this._samples);
    this._times[this.length] = timeS;
    for (const [name, column] of this._columns) column[this.length] = read(name);
    this.length += 1;
  }

  /** @param {number} count */
  _drop(count) {
    for (const column of [this._times, ...this._columns.values()]) column.copyWithin(0, count);
    this.length -= count;
  }

  /**
   * Return the index range [from, to) of the samples in a time span, both ends included.
   * @param {number} fromS @param {number} toS
   */
  places(fromS, toS) {
    return [this._count((time) => time < fromS), this._count((time) => time <= toS)];
  }

  /** Return the number of times before a limit. @param {(time: number) => boolean} isBefore */
  _count(isBefore) {
    let [low, high] = [0, this.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (isBefore(this._times[middle])) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /**
   * Return a time span as CSV: robot time in seconds, and a column per field.
   * @param {PlotField[]} fields @param {number} fromS @param {number} toS
   */
  csv(fields, fromS, toS) {
    const unit = (/** @type {PlotField} */ of) => of.unit.replace("°", "deg").replace("µ", "u");
    const columns = [this.times, ...fields.map(({ name }) => this.values(name))];
    const lines = [["robot_time [s]", ...fields.map((of) => `${of.name} [${unit(of)}]`)].join()];
    const [from, to] = this.places(fromS, toS);
    const text = (/** @type {number} */ value) => (Number.isNaN(value) ? "nan" : String(value));
    for (let i = from; i < to; i += 1) lines.push(columns.map((column) => text(column[i])).join());
    return `${lines.join("\n")}\n`;
  }
}
