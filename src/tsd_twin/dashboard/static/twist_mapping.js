// Mapping between the three components of a twist and the controls: stick up, stick left, turn left.

/**
 * @typedef {object} TwistMapping
 * @property {(x: number, y: number, turn: number) => Triple} twist
 * @property {(twist: Triple) => Unit} unit
 * @property {[string, string, string]} stick
 * @property {string} words
 */

/** @type {TwistMapping} */
const FLOOR = {
  twist: (x, y, turn) => [x, y, turn],
  unit: ([a, b, c]) => ({ x: a, y: b, turn: c }),
  stick: ["forward", "left", "m/s"],
  words: "Up is forward, left is left",
};
// Up rolls the top of the ball away, left to the left: about Y, and about minus X.
/** @type {TwistMapping} */
const BALL = {
  twist: (x, y, turn) => [-y, x, turn],
  unit: ([a, b, c]) => ({ x: b, y: -a, turn: c }),
  stick: ["rolling forward", "rolling left", "rad/s"],
  words: "Up rolls the sphere forward, left to the left",
};

/**
 * Return how the controls move what a robot moves.
 * @param {RobotInfo | null} robot
 */
export function twistMappingOf(robot) {
  return robot?.space === "ball" ? BALL : FLOOR;
}

/**
 * Return a vector turned by a unit quaternion w, x, y, z.
 * @param {Quaternion} turn
 * @param {Triple} vector
 * @returns {Triple}
 */
export function rotated([w, x, y, z], [a, b, c]) {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}
