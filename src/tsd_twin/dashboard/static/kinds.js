// Registry of the kinds of robots in the page: what differs by `panel` of the robot's description.
// All other modules ask `kindOf`, and name no kind.

import { degrees, fixed } from "./format.js";
import { Gimbals } from "./gimbals.js";
import { Sphere } from "./sphere.js";
import { Wheels } from "./wheels.js";

/** @type {Pick<Kind, "onFloor" | "controls" | "readings">} */
const ON_FLOOR = {
  onFloor: true,
  controls: {
    twist: (x, y, turn) => [x, y, turn],
    unit: ([vx, vy, omega]) => ({ x: vx, y: vy, turn: omega }),
    labels: ["forward", "left", "m/s"],
    help: "Up is forward, left is left",
  },
  readings: {
    Pose: [
      ["x", "m", ({ pose }) => fixed(pose?.[0], 2)],
      ["y", "m", ({ pose }) => fixed(pose?.[1], 2)],
      ["heading", "°", ({ pose }) => degrees(pose?.[2])],
    ],
    Speed: [
      ["v", "m/s", ({ twist }) => fixed(twist ? Math.hypot(twist[0], twist[1]) : undefined, 2)],
      ["ω", "rad/s", ({ twist }) => fixed(twist?.[2], 2)],
    ],
  },
};

const MOTORS = {
  arm: "Switch the motors on",
  disarm: "Switch the motors off",
  armHint: "The motors hold the robot from then on.",
};

/** @type {PlotRow} */
const RESIDUAL_PLOT = {
  title: "Conflict",
  unit: "m/s",
  decimals: 3,
  least: 0.02,
  series: [["residual", "residual"]],
};

/** @type {(robot: RobotInfo) => PlotRow} */
const wheelPlot = ({ wheels, max_rpm: most }) => ({
  title: "Wheels",
  unit: "rpm",
  decimals: 0,
  least: (most ?? NaN) / 10,
  series: wheels.map((name, i) => [String(i + 1), name]),
  commanded: true,
});

/** @type {Record<RobotInfo["panel"], Kind>} */
const KINDS = {
  gimbals: {
    ...ON_FLOOR,
    arm: "Check neutral tilt, then spin the wheels up",
    disarm: "Spin the wheels down",
    armHint: "The wheels spin up. They spin even when the robot stands still.",
    Panel: Gimbals,
    plots: ({ modules }) => [
      {
        title: "Tilt",
        unit: "°",
        decimals: 1,
        least: 5,
        series: modules.map((name, i) => [String(i + 1), `tilt ${name}`]),
      },
      RESIDUAL_PLOT,
    ],
  },
  wheels: {
    ...ON_FLOOR,
    ...MOTORS,
    Panel: Wheels,
    plots: (robot) => [wheelPlot(robot), RESIDUAL_PLOT],
  },
  sphere: {
    ...MOTORS,
    onFloor: false,
    controls: {
      // Up rolls the top of the sphere away, left to the left: about Y, and about minus X.
      twist: (x, y, turn) => [-y, x, turn],
      unit: ([wx, wy, wz]) => ({ x: wy, y: -wx, turn: wz }),
      labels: ["rolling forward", "rolling left", "rad/s"],
      help: "Up rolls the sphere forward, left to the left",
    },
    readings: {
      Pose: [["turned", "°", ({ sphere }) => turnedBy(sphere)]],
      Speed: [
        ["ωx", "", ({ twist }) => fixed(twist?.[0], 2)],
        ["ωy", "", ({ twist }) => fixed(twist?.[1], 2)],
        ["ωz", "rad/s", ({ twist }) => fixed(twist?.[2], 2)],
      ],
    },
    Panel: Sphere,
    plots: (robot) => [
      wheelPlot(robot),
      {
        title: "Models apart",
        unit: "°",
        decimals: 1,
        least: 4,
        series: [["ideal to dual", "models"]],
      },
    ],
  },
};

/** Return the kind of a robot, the first one before a robot is known. @param {RobotInfo | null} robot */
export function kindOf(robot) {
  return KINDS[robot?.panel ?? "gimbals"];
}

/** Degrees from where it was built in. @param {SphereState | null | undefined} sphere */
function turnedBy(sphere) {
  if (!sphere) return "–";
  const [w, x, y, z] = sphere.wxyz;
  return fixed((2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w)) * 180) / Math.PI, 0);
}
