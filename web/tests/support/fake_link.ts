// A link whose dashboard is the test: it sends messages and reads the page's.

import { vi } from "vitest";
import type { RobotInfo, RobotState, RobotStatus } from "../../src/generated/wire.ts";
import { Link } from "../../src/store/link.ts";
import { FakeSocket, openWindow } from "./fake_socket.ts";
import { ROBOT as BASE, STATE as REST, STATUS } from "./messages.ts";

export const ROBOT = {
  ...BASE,
  modules: ["module1", "module2"],
  plot_fields: ["requested.vx_mps", "joints.module1_alpha.position_rad", "odom.sigma.heading_rad"],
} as RobotInfo;

/** Status of a robot whose readings are all within their bands. */
export function statusOf(change: Record<string, unknown> = {}): RobotStatus {
  const dropped = { stale: 0, lease: 0, order: 0, nonfinite: 0, key: 0, shape: 0 };
  const contributions = { module1: 0.3 };
  return {
    ...STATUS,
    mode: "driving",
    command: { ...STATUS.command, dropped },
    limits: { ...STATUS.limits, speed_mps: 1, max_command_age_s: 0.2 },
    consistency: { residual_mps: 0.012, suspect: null, level: 0.4, contributions },
    hardware: { kind: "sim", battery_v: 12.3, pulse_us: [1500, 1501] },
    ...change,
  } as RobotStatus;
}

export const STATE = {
  ...REST,
  rtt_ms: 10,
  pose: [1, 2, 0.5],
  twist: [0.1, 0.2, 0.3],
  commanded: [0.4, 0.5, 0.6],
  modules: [
    { alpha: 1, setpoint: { alpha: 2 }, tilt: 3, rpm: 2500, axle: [0.1, 0.2] },
    { alpha: 4, setpoint: { alpha: 5, axle: [0, 0.1] }, tilt: 6, rpm: 2510, axle: [0.3, 0.4] },
  ],
} as unknown as RobotState;

/** Connect with timers of the test, and a round trip of 0 ms between page and dashboard. */
export function connect(recording: string | null = null) {
  vi.useFakeTimers();
  openWindow();
  const link = new Link("1", recording);
  link.open();
  const socket = FakeSocket.newest;
  socket.onopen();
  const say = (message: object) => socket.say(message);
  let seq = 0;
  const state = (change: object = {}, status: Record<string, unknown> = {}) => {
    say({ ...STATE, status_seq: (seq += 1), status: statusOf(status), ...change });
  };
  const take = (kind: string) => socket.take(kind);
  const lose = () => socket.onclose();
  return { link, say, state, take, lose, pass: (ms: number) => vi.advanceTimersByTime(ms) };
}
