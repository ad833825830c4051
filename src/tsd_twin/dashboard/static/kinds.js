// Registry of robot kinds on the page, selected by `panel` in the robot description. All other
// modules use `kindOf` and name no kind.

import { degrees, fixed } from "./format.js";
import { Gimbals } from "./gimbals.js";
import { Imported } from "./imported.js";
import { Joints } from "./joints.js";
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

/** @param {RobotInfo} robot */
const twists = ({ twist_axes: axes }) =>
  ["commanded", "twist"].flatMap((twist) => axes.map(({ name }) => `${twist}.${name}`));
/** @param {RobotInfo} robot */
const wheelSpeeds = ({ wheels }) =>
  ["rpm_setpoint", "rpm"].flatMap((speed) => wheels.map((name) => `wheels.${name}.${speed}`));
const RESIDUAL = "status.consistency.residual_mps";
const ROUND_TRIP = "link.round_trip_ms";

/** @type {Record<RobotInfo["panel"], Kind>} */
const KINDS = {
  gimbals: {
    ...ON_FLOOR,
    arm: "Check neutral tilt, then spin the wheels up",
    disarm: "Spin the wheels down",
    armHint: "The wheels spin up. They spin even when the robot stands still.",
    Panel: Gimbals,
    plots: (robot) => [
      ...twists(robot),
      ...robot.modules.map((name) => `modules.${name}.tilt`),
      RESIDUAL,
      ROUND_TRIP,
    ],
  },
  wheels: {
    ...ON_FLOOR,
    ...MOTORS,
    Panel: Wheels,
    plots: (robot) => [...twists(robot), ...wheelSpeeds(robot), RESIDUAL, ROUND_TRIP],
  },
  sphere: {
    ...MOTORS,
    onFloor: false,
    controls: {
      // Up rolls the top of the sphere away (about Y), left rolls it left (about minus X).
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
    plots: (robot) => [...twists(robot), ...wheelSpeeds(robot), "sphere.angle_deg", ROUND_TRIP],
  },
  twist: {
    ...ON_FLOOR,
    arm: "Let commands through to cmd_vel of ROS: where it stops is not promised",
    disarm: "Let no commands through",
    armHint:
      "Other ROS nodes can drive it as well. Where it stops is not promised: see the tab ROS.",
    Panel: Imported,
    plots: (robot) => [...twists(robot), ROUND_TRIP],
  },
  joints: {
    ...ON_FLOOR,
    ...MOTORS,
    Panel: Joints,
    plots: (robot) => [...twists(robot), RESIDUAL, ROUND_TRIP],
  },
};

/**
 * Return the kind of a robot, or the first kind if the robot is unknown.
 * @param {RobotInfo | null} robot
 */
export function kindOf(robot) {
  return KINDS[robot?.panel ?? "gimbals"];
}

/**
 * Rotation from the mounted orientation, in degrees.
 * @param {SphereState | null | undefined} sphere
 */
function turnedBy(sphere) {
  if (!sphere) return "–";
  const [w, x, y, z] = sphere.wxyz;
  return fixed((2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w)) * 180) / Math.PI, 0);
}
