// A page without a dashboard: the test sends messages and reads the page's replies.

import { vi } from "vitest";

import type { RobotState } from "../../src/generated/wire";
import { Session } from "../../src/session";
import { FakeSocket, openWindow } from "./fake_socket";
import { LEASE, ROBOT, STATE, STATUS, WELCOME } from "./messages";

export const ME = "web-0000000a";
const TITLE = "Triple singularity drive";

/** Deep parts of a state that a test changes. */
export type StateChange = {
  mode?: string;
  lease?: Record<string, unknown>;
  refusals?: Record<string, unknown> | null;
  status?: Record<string, unknown>;
  state?: Partial<RobotState>;
};

export interface FakePage {
  session: Session;
  say: (message: Record<string, unknown>) => void;
  state: (change?: StateChange) => void;
  /** Messages of a kind that the page has sent. */
  sent: (kind: string) => Record<string, unknown>[];
  disconnect: () => void;
  /** Advance the time, with heartbeats. */
  pass: (ms: number) => void;
}

/** Open a page with timers of the test; `welcome` changes what the dashboard says first. */
export function openPage(welcome: Record<string, unknown> = {}): FakePage {
  vi.useFakeTimers();
  openWindow();
  const session = new Session();
  session.link.open();
  const socket = FakeSocket.newest;
  const say = (message: object) => socket.say(message);
  const robots = [{ id: "tsd", title: TITLE, colour: "#1d96fe" }];
  socket.onopen();
  say({ ...WELCOME, operator: ME, robots, ...welcome });
  say({ ...ROBOT, title: TITLE });
  let seq = 0;
  return {
    session,
    say,
    state: (change = {}) => say(stateOf((seq += 1), change)),
    sent: (kind) => socket.sent.filter(({ t }) => t === kind),
    disconnect: () => socket.onclose(),
    pass: (ms) => void vi.advanceTimersByTime(ms),
  };
}

function stateOf(status_seq: number, change: StateChange): Record<string, unknown> {
  const lease = { ...LEASE, holder: ME, ...change.lease };
  const limits = { ...STATUS.limits, speed_mps: 1, turn_rate_rad_per_s: 1, max_command_age_s: 0.2 };
  return {
    ...STATE,
    status_seq,
    has_control: lease.holder === ME,
    ...change.state,
    status: {
      ...STATUS,
      mode: change.mode ?? "ready",
      lease,
      refusals: change.refusals ?? null,
      limits,
      ...change.status,
    },
  };
}
