// Map viewport (position and scale) and robot trails. World x is up and y is left, as on the stick
// with world axes.

const SPANS_M = [1, 2, 4, 8, 16, 32, 64]; // Along the smaller side.
const USUAL_SPAN_M = 4;
const CALM = 0.25; // Maximum offset of the robot from the centre, relative to the smaller side.
const TRAIL_SPACING_M = 0.05; // As in sessions/map_data.py, like the next two.
const TRAIL_JUMP_M = 0.5;
const TRAIL_POINTS = 800;

export class MapView {
  constructor() {
    this.spanM = USUAL_SPAN_M;
    /** @type {FloorPoint} */
    this._middle = [0, 0];
    this._box = { left: 0, top: 0, width: 1, height: 1 };
  }

  /** Pixels per metre. */
  get scale() {
    return Math.min(this._box.width, this._box.height) / this.spanM;
  }

  get box() {
    return this._box;
  }

  /** Use this part of the picture. @param {MapBox} box */
  fit(box) {
    this._box = box;
  }

  /** Zoom in (-1) or out (1), or to a stored span. @param {number} steps */
  zoom(steps) {
    const at = SPANS_M.indexOf(this.spanM) + steps;
    this.spanM = SPANS_M[Math.max(0, Math.min(SPANS_M.length - 1, at))];
  }

  /** @param {number} spanM */
  setSpan(spanM) {
    if (SPANS_M.includes(spanM)) this.spanM = spanM;
  }

  /** Pan as little as needed to keep a place near the centre. @param {FloorPoint} place */
  follow(place) {
    const most = CALM * this.spanM;
    const nearer = (/** @type {number} */ at, /** @type {number} */ to) =>
      Math.max(to - most, Math.min(to + most, at));
    this._middle = [nearer(this._middle[0], place[0]), nearer(this._middle[1], place[1])];
  }

  /** Convert a floor point to pixels. @param {FloorPoint} place @returns {[number, number]} */
  toPicture([x, y]) {
    const { left, top, width, height } = this._box;
    return [
      left + width / 2 - (y - this._middle[1]) * this.scale,
      top + height / 2 - (x - this._middle[0]) * this.scale,
    ];
  }

  /**
   * Convert pixels to a floor point, rounded to 1 mm.
   * @param {[number, number]} pixels @returns {FloorPoint}
   */
  toFloor([right, down]) {
    const { left, top, width, height } = this._box;
    const x = this._middle[0] + (top + height / 2 - down) / this.scale;
    const y = this._middle[1] + (left + width / 2 - right) / this.scale;
    return [Math.round(1000 * x) / 1000, Math.round(1000 * y) / 1000];
  }

  /** Length of the scale bar in metres: 1, 2 or 5 times a power of ten, up to 40 % of the width. */
  barM() {
    const most = (0.4 * this._box.width) / this.scale;
    const power = 10 ** Math.floor(Math.log10(most));
    return ([5, 2, 1].find((each) => each * power <= most) ?? 1) * power;
  }

  /** Grid spacing: 1 m, or 10 m if the lines would be too close. */
  gridM() {
    return this.scale >= 8 ? 1 : 10;
  }
}

const LABEL_GAP_PX = 14; // Room for the tip of a robot.
const LABEL_PX = 16; // Line height including gap.

/**
 * Return label positions (centre of the baseline, in pixels): below, above, right or left of the
 * robots, never on another label, and not on a circle if there is room. A label is not cut off at
 * the edges `low` and `high` while its robot is between them.
 * @param {{ at: [number, number], radius: number, width: number }[]} robots
 * @param {[number, number]} edges
 * @returns {[number, number][]}
 */
export function labelPlaces(robots, [low, high] = [-Infinity, Infinity]) {
  /** @type {{ left: number, right: number, top: number, bottom: number }[]} */
  const taken = [];
  const circles = robots.map(({ at: [x, y], radius }) => ({
    left: x - radius,
    right: x + radius,
    top: y - radius,
    bottom: y + radius,
  }));
  return robots.map(({ at: [x, y], radius, width }) => {
    const [aside, below] = [radius + LABEL_GAP_PX + width / 2, radius + LABEL_GAP_PX + 10];
    const isIn = low <= x && x <= high;
    const middle = isIn ? Math.max(low + width / 2 + 4, Math.min(x, high - width / 2 - 4)) : x;
    /** @type {[number, number][]} */
    const places = [
      [middle, y + below],
      [middle, y - radius - LABEL_GAP_PX],
      [x + aside, y + 4],
      [x - aside, y + 4],
      ...robots.map(
        (_, i) => /** @type {[number, number]} */ ([middle, y + below + (i + 1) * LABEL_PX]),
      ),
    ];
    const boxOf = (/** @type {[number, number]} */ [right, down]) => ({
      left: right - width / 2 - 2,
      right: right + width / 2 + 2,
      top: down - LABEL_PX + 4,
      bottom: down + 4,
    });
    const isFree = (/** @type {[number, number]} */ place, /** @type {typeof taken} */ others) => {
      const box = boxOf(place);
      return others.every(
        ({ left, right, top, bottom }) =>
          box.right <= left || box.left >= right || box.bottom <= top || box.top >= bottom,
      );
    };
    const place =
      places.find((each) => isFree(each, [...taken, ...circles])) ??
      places.find((each) => isFree(each, taken)) ??
      places[0];
    taken.push(boxOf(place));
    return place;
  });
}

/** @param {number} metres */
export function lengthText(metres) {
  if (metres < 0.995) return `${Math.round(100 * metres)} cm`;
  return `${Math.round(metres)} m`;
}

/** Trails of the estimates: those from the server, extended with the latest poses. */
export class MapTrails {
  constructor() {
    /** @type {Map<string, (FloorPoint | null)[]>} */
    this._trails = new Map();
  }

  /** @param {Record<string, (FloorPoint | null)[]>} trails */
  replace(trails) {
    this._trails = new Map(Object.entries(trails));
  }

  /** @param {MapRobot[]} robots */
  extend(robots) {
    for (const { id, pose } of robots) {
      const trail = this._trails.get(id) ?? [];
      this._trails.set(id, trail);
      const last = trail.at(-1);
      const step = last ? Math.hypot(pose[0] - last[0], pose[1] - last[1]) : Infinity;
      if (step < TRAIL_SPACING_M) continue;
      if (last && step >= TRAIL_JUMP_M) trail.push(null);
      trail.push([pose[0], pose[1]]);
      if (trail.length > TRAIL_POINTS) trail.splice(0, trail.length - TRAIL_POINTS);
    }
  }

  /** @param {string} id */
  of(id) {
    return this._trails.get(id) ?? [];
  }
}
