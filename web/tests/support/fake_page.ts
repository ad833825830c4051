// A page without a dashboard: the test sends the messages, and reads what the page has sent.

import { vi } from "vitest";

import type { RobotState } from "../../src/generated/wire";
import type { Session } from "../../src/session";

export const ME = "web-0000000a";

/** Deep parts of a state that a test changes. */
export type StateChange = {
  mode?: string;
  lease?: Record<string, unknown>;
  refusals?: Record<string, unknown> | null;
  status?: Record<string, unknown>;
  state?: Partial<RobotState>;
};

class Socket {
  static OPEN = 1;
  static newest: Socket | null = null;
  readyState = Socket.OPEN;
  bufferedAmount = 0;
  readonly sent: Record<string, unknown>[] = [];
  onopen = () => {};
  onclose = () => {};
  onmessage = (_: { data: string }) => {};

  constructor(readonly address: URL) {
    Socket.newest = this;
  }

  send(text: string): void {
    this.sent.push(JSON.parse(text) as Record<string, unknown>);
  }

  close(): void {
    this.readyState = 3;
  }
}

export interface FakePage {
  session: Session;
  say: (message: Record<string, unknown>) => void;
  state: (change?: StateChange) => void;
  /** Messages of a kind that the page has sent. */
  sent: (kind: string) => Record<string, unknown>[];
  disconnect: () => void;
  /** Let time pass, with heartbeats. */
  pass: (ms: number) => void;
}

const ends: (() => void)[] = [];
const listen = globalThis.addEventListener;

/** As of a window of its own: listeners of the page before are gone. */
function openWindow(): void {
  for (const end of ends.splice(0)) end();
  vi.stubGlobal("addEventListener", (...args: Parameters<typeof listen>) => {
    listen(...args);
    ends.push(() => removeEventListener(...args));
  });
}

/** Open a page with timers of the test; `welcome` changes what the dashboard says first. */
export async function openPage(welcome: Record<string, unknown> = {}): Promise<FakePage> {
  vi.useFakeTimers();
  openWindow();
  vi.stubGlobal("WebSocket", Socket);
  const { Session } = await import("../../src/session");
  const session = new Session();
  session.link.open();
  const socket = Socket.newest!;
  const say = (message: Record<string, unknown>) => {
    if (message["t"] === "state") socket.onmessage({ data: heartbeat() });
    socket.onmessage({ data: JSON.stringify(message) });
  };
  const robots = [{ id: "tsd", title: "Triple singularity drive", colour: "#1d96fe" }];
  socket.onopen();
  const me = { operator: ME, name: "", role: "operator", user: null, may_stop: true };
  say({ t: "welcome", ...me, robots, robot: "tsd", ...welcome });
  say({
    t: "robot",
    id: "tsd",
    title: "Triple singularity drive",
    space: "floor",
    twist_scale_m: 1,
  });
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

const heartbeat = () => JSON.stringify({ t: "heartbeat", sent_ms: performance.now() });

function stateOf(status_seq: number, change: StateChange): Record<string, unknown> {
  const lease = { holder: ME, requested_by: null, request_expires_in_s: 0, reserved_for: null };
  return {
    t: "state",
    status_seq,
    age_ms: 0,
    source: "robot",
    has_control: { ...lease, ...change.lease }.holder === ME,
    rtt_ms: 5,
    rtt_jitter_ms: 1,
    ...change.state,
    status: {
      mode: change.mode ?? "ready",
      lease: { ...lease, ...change.lease },
      refusals: change.refusals ?? null,
      limits: { speed_mps: 1, turn_rate_rad_per_s: 1, max_command_age_s: 0.2, why: [] },
      hardware: {},
      operators: {},
      ...change.status,
    },
  };
}
