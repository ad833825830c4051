// What the three numbers of a twist have to do with the controls: stick up, stick left, turn left.

const FLOOR = {
  twist: (x, y, turn) => [x, y, turn],
  unit: ([a, b, c]) => ({ x: a, y: b, turn: c }),
  stick: ["forward", "left", "m/s"],
  words: "Up is forward, left is left",
};
// Up rolls the top of the ball away, left to the left: about Y, and about minus X.
const BALL = {
  twist: (x, y, turn) => [-y, x, turn],
  unit: ([a, b, c]) => ({ x: b, y: -a, turn: c }),
  stick: ["rolling forward", "rolling left", "rad/s"],
  words: "Up rolls the sphere forward, left to the left",
};

/** Return how the controls move what a robot moves. */
export function spaceOf(robot) {
  return robot?.space === "ball" ? BALL : FLOOR;
}
