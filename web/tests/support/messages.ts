// Whole messages of a dashboard, whose fields a test replaces: parts of the page may read any of them.

import type { RobotInfo, RobotState, RobotStatus } from "../../src/generated/wire";

export const AXES = [
  { name: "vx", symbol: "vx", unit: "m/s" },
  { name: "vy", symbol: "vy", unit: "m/s" },
  { name: "omega", symbol: "ω", unit: "rad/s" },
];

/** A robot with three modules on the floor. */
export const ROBOT = {
  t: "robot",
  id: "tsd",
  title: "tsd",
  space: "floor",
  panel: "gimbals",
  max_speed_mps: 2,
  modules: ["module1", "module2", "module3"],
  twist_axes: AXES,
  twist_scale_m: 1,
  max_tilt_deg: 30,
  sideways: true,
  wheels: [],
  joints: [],
  plot_fields: [],
  not_promised: [],
  wheel_speed_limits: null,
  alternative_estimate: null,
  selection: 1,
} as RobotInfo;

export const LEASE = {
  holder: "ann",
  remaining_s: 5,
  requested_by: null,
  request_expires_in_s: 0,
  reserved_for: null,
  reservation_expires_in_s: 0,
};

/** The robot is ready, and all readings are within their bands. */
export const STATUS = {
  mode: "ready",
  stop: null,
  arming: null,
  lease: LEASE,
  refusals: null,
  command: { seq: 1, age_s: 0, echo_s: 0.01, accepted: 100, dropped: {} },
  limits: {
    speed_mps: 2,
    turn_rate_rad_per_s: 4,
    max_command_age_s: 0.25,
    stop_allowance_m: 0.3,
    applied: 1,
    why: [],
  },
  consistency: { residual_mps: 0, suspect: null, level: 0, contributions: {} },
  pose_sensor: null,
  learned: null,
  loop: { hz: 100, overruns: 0, jitter_p99_ms: 1, longest_ms: 11 },
  hardware: {},
  operators: {},
} as unknown as RobotStatus;

export const STATE = {
  t: "state",
  selection: 1,
  status_seq: 0,
  robot_s: 1,
  age_ms: 0,
  mode_age_s: 12,
  source: "robot",
  has_control: true,
  rtt_ms: 5,
  rtt_jitter_ms: 1,
  pose: [1, 2, 0],
  twist: [0, 0, 0],
  commanded: [0, 0, 0],
  truth: null,
  modules: [],
  wheels: [],
  joints: [],
  sphere: null,
  route: null,
  map: null,
  estimate_difference: null,
  plot: {},
  past: null,
  shadow: null,
  status: STATUS,
} as unknown as RobotState;

export const WELCOME = {
  t: "welcome",
  operator: "ann",
  name: "",
  role: "operator",
  user: null,
  may_stop: true,
  robots: [{ id: "tsd", title: "tsd", colour: "#1d96fe" }],
  robot: "tsd",
};
