// The last twenty seconds of what is plotted, kept from the moment the page is opened.

export const SPAN_S = 20;
const LENGTH = 1024;
const NOTHING = [null, null, null];

export class Recorder {
  constructor(link) {
    this.times = new Float64Array(LENGTH);
    this.rows = new Map(); // Name of a channel to its values, in the same places as the times.
    this.count = 0; // Samples so far; the newest is at (count - 1) modulo the length.
    this.card = null; // Of the robot that is recorded.
    link.on("state", (state) => this._take(state, link));
    link.on("robot", (robot) => this._begin(robot));
  }

  get length() {
    return Math.min(this.count, LENGTH);
  }

  /** Call `each(time_s, value)` for a channel, oldest first, from a time on. */
  each(channel, fromS, each) {
    const values = this.rows.get(channel);
    if (values === undefined) return;
    for (let i = this.count - this.length; i < this.count; i += 1) {
      const at = i % LENGTH;
      if (this.times[at] >= fromS) each(this.times[at], values[at]);
    }
  }

  newest(channel) {
    return this.count === 0 ? NaN : (this.rows.get(channel)?.[(this.count - 1) % LENGTH] ?? NaN);
  }

  _begin(robot) {
    if (this.robot === robot.id) return;
    this.robot = robot.id;
    this.card = robot;
    this.count = 0;
    this.rows.clear();
  }

  _take(state, link) {
    if (this.card === null) return;
    const at = this.count % LENGTH;
    this.times[at] = performance.now() / 1000;
    const commanded = state.commanded ?? NOTHING;
    const twist = state.twist ?? NOTHING;
    this.card.numbers.forEach(({ name }, i) => {
      this._put(`set ${name}`, at, commanded[i]);
      this._put(name, at, twist[i]);
    });
    this.card.modules.forEach((name, i) => this._put(`tilt ${name}`, at, state.modules[i]?.tilt));
    this.card.wheels.forEach((name, i) => {
      this._put(`set ${name}`, at, state.wheels[i]?.set_rpm);
      this._put(name, at, state.wheels[i]?.rpm);
    });
    this._put("models", at, state.ball?.angle_deg);
    this._put("conflict", at, state.status.conflict.residual_mps);
    this._put("latency", at, link.roundTripMs());
    this.count += 1;
  }

  _put(channel, at, value) {
    if (!this.rows.has(channel)) this.rows.set(channel, new Float64Array(LENGTH).fill(NaN));
    this.rows.get(channel)[at] = value ?? NaN;
  }
}
