// A link whose dashboard is the test: it sends messages and reads the page's.

import { vi } from "vitest";
import type { RobotInfo, RobotState, RobotStatus } from "../../src/generated/wire.ts";
import { Link } from "../../src/store/link.ts";

type Message = { t: string } & Record<string, unknown>;

export const AXES = [
  { name: "vx", symbol: "vx", unit: "m/s" },
  { name: "vy", symbol: "vy", unit: "m/s" },
  { name: "omega", symbol: "ω", unit: "rad/s" },
];

export const ROBOT = {
  t: "robot",
  id: "tsd",
  title: "TSD",
  panel: "gimbals",
  twist_axes: AXES,
  twist_scale_m: 1,
  modules: ["module1", "module2"],
  wheels: [],
  not_promised: [],
  plot_fields: ["requested.vx_mps", "joints.module1_alpha.position_rad", "odom.sigma.heading_rad"],
} as unknown as RobotInfo;

/** Status of a robot whose readings are all within their bands. */
export function statusOf(change: Record<string, unknown> = {}): RobotStatus {
  const dropped = { stale: 0, lease: 0, order: 0, nonfinite: 0, key: 0, shape: 0 };
  return {
    mode: "driving",
    stop: null,
    lease: { holder: "web-1", remaining_s: 2, requested_by: null, reserved_for: null },
    command: { seq: 1, age_s: 0, echo_s: 0.01, accepted: 100, dropped },
    limits: {
      speed_mps: 1,
      max_command_age_s: 0.2,
      stop_allowance_m: 0.3,
      applied: 1,
      why: [],
    },
    consistency: {
      residual_mps: 0.012,
      suspect: null,
      level: 0.4,
      contributions: { module1: 0.3 },
    },
    pose_sensor: null,
    learned: null,
    loop: { hz: 100, overruns: 0, jitter_p99_ms: 1, longest_ms: 11 },
    hardware: { kind: "sim", battery_v: 12.3, pulse_us: [1500, 1501] },
    operators: {},
    ...change,
  } as unknown as RobotStatus;
}

export const STATE = {
  t: "state",
  status_seq: 0,
  robot_s: 1,
  age_ms: 0,
  source: "robot",
  has_control: true,
  rtt_ms: 10,
  rtt_jitter_ms: 1,
  pose: [1, 2, 0.5],
  twist: [0.1, 0.2, 0.3],
  commanded: [0.4, 0.5, 0.6],
  truth: null,
  modules: [
    { alpha: 1, alpha_setpoint: 2, tilt: 3, rpm: 2500, axle: [0.1, 0.2], spinning: true },
    { alpha: 4, alpha_setpoint: 5, tilt: 6, rpm: 2510, axle: [0.3, 0.4], spinning: true },
  ],
  wheels: [],
  sphere: null,
  estimate_difference: null,
  plot: {},
  shadow: null,
} as unknown as RobotState;

/** Connect with timers of the test, and a round trip of 0 ms between page and dashboard. */
export function connect(recording: string | null = null) {
  vi.useFakeTimers();
  let socket: FakeSocket | null = null;
  class FakeSocket {
    static OPEN = 1;
    readyState = 1;
    bufferedAmount = 0;
    onopen = () => {};
    onclose = () => {};
    onmessage = (_: { data: string }) => {};
    constructor() {
      socket = this;
    }
    send(text: string) {
      sent.push(JSON.parse(text) as Message);
    }
    close() {}
  }
  const sent: Message[] = [];
  vi.stubGlobal("WebSocket", FakeSocket);
  const link = new Link({ page: "1", recording, name: "", hasFocus: () => true });
  link.open();
  socket!.onopen();
  const say = (message: object) => socket!.onmessage({ data: JSON.stringify(message) });
  let seq = 0;
  const state = (change: object = {}, status: Record<string, unknown> = {}) => {
    say({ t: "heartbeat", sent_ms: performance.now() });
    say({ ...STATE, status_seq: (seq += 1), status: statusOf(status), ...change });
  };
  /** Messages of a kind since the last call. */
  const take = (kind: string) => {
    const taken = sent.filter(({ t }) => t === kind);
    sent.splice(0, sent.length, ...sent.filter(({ t }) => t !== kind));
    return taken;
  };
  const lose = () => socket!.onclose();
  return { link, say, state, take, lose, pass: (ms: number) => vi.advanceTimersByTime(ms) };
}
