// What stands left of STOP: one sentence, and the next step. Evaluated in one place, so that no two
// states claim the place and each state is a row in the tests.

import { isOnFloor } from "../drive/axes";
import type { RobotState, RouteState } from "../generated/wire";
import type { Session } from "../session";
import { freshness } from "../store/freshness";
import {
  isLatched,
  type Refusal,
  whyNotArm,
  whyNotDrive,
  whyNotReset,
  whyNotTakeControl,
} from "../store/permission";
import { controlTerms, type Requests } from "../store/requests";
import { duration, figure } from "../text/numbers";
import { nameOf, refusalText, sentence } from "../text/reasons";
import { texts } from "../text/text";

const ARMED = new Set(["ready", "driving", "stopping"]);

type Request = Parameters<Requests["send"]>[0];

export interface Action {
  text: string;
  /** What it sends, or does. */
  does: Request | (() => void);
  refused?: Refusal | null;
  hold?: boolean;
}

export interface Step {
  /** Name of the state. */
  id: string;
  title?: string;
  /** Operator's name in the title. */
  name?: string;
  detail?: string;
  /** Fraction that is done. */
  progress?: number;
  /** The filled button, and the quiet one beside it. */
  next?: Action;
  quiet?: Action;
  /** Whether the next step is to hold the path. */
  path?: boolean;
}

/** Speed in m/s, or the rate of rolling in rad/s for a sphere, with its unit. */
export function speedOf(session: Session): { value: number | null; unit: "m/s" | "rad/s" } {
  const unit = isOnFloor(session.link.robot.value) ? "m/s" : "rad/s";
  const [a, b] = session.link.state.value?.twist ?? [];
  return { value: a === undefined || b === undefined ? null : Math.hypot(a, b), unit };
}

/** Return the step for the state of robot and page; it follows all signals that it depends on. */
export function stepOf(session: Session): Step {
  const { link, stop } = session;
  const { deck, common } = texts();
  void link.beat.value;
  if (stop.unconfirmed.value) {
    const quiet = { text: deck.acknowledge, does: () => stop.acknowledge() };
    return { id: "unconfirmed", title: deck.unconfirmed, detail: deck.unconfirmedThen, quiet };
  }
  const fresh = freshness(link);
  if (fresh.kind === "offline" || fresh.kind === "silent") {
    const title = deck[fresh.kind](duration(fresh.forMs / 1000));
    return { id: fresh.kind, title, detail: deck.reconnecting };
  }
  if (fresh.kind === "no_robot") return { id: "no_robot", title: common.refusals["no_robot"] };
  if (fresh.kind === "recorded")
    return fresh.by === "page"
      ? { id: "past" }
      : { id: "replay", title: common.refusals["replay_shown"] };
  const state = link.state.value;
  if (fresh.kind === "starting" || state === null) return { id: "starting" };
  if (link.welcome.value?.role === "viewer")
    return { ...driver(session, state), id: "viewer", detail: common.refusals["viewer_only"] };
  return state.has_control ? withControl(session, state) : withoutControl(session, state);
}

function withControl(session: Session, state: RobotState): Step {
  const { link, path } = session;
  const { deck } = texts();
  const { mode, lease, arming } = state.status;
  const asker = lease.requested_by;
  const route = path.route.value;
  // First: it is held, and would be released with its button.
  if (path.going.value && route) return follow(route, true);
  if (asker !== null) {
    const name = nameOf(asker);
    const answer = (op: "grant" | "deny") => ({ t: "lease", op, requester: asker }) as const;
    return {
      id: "asked",
      title: deck.asks(name),
      name,
      detail: deck.asksThen(duration(Math.ceil(lease.request_expires_in_s))),
      next: { text: deck.handOver, does: answer("grant") },
      quiet: { text: deck.keep, does: answer("deny") },
    };
  }
  if (isLatched(link)) {
    const next = { text: deck.reset, does: { t: "reset" } as const, hold: true };
    return { ...latched(session, state), next: { ...next, refused: whyNotReset(link) } };
  }
  if (mode === "disarmed") {
    const next = { text: deck.arm, does: { t: "arm" } as const, refused: whyNotArm(link) };
    const panel = link.robot.value?.panel;
    const detail = deck.armThen[panel === "gimbals" || panel === "twist" ? panel : "other"];
    return { id: "disarmed", title: deck.yours, detail, next };
  }
  if (mode === "arming") {
    const isTilted = (link.robot.value?.modules.length ?? 0) > 0;
    const phase = arming?.phase === "hold" && isTilted ? "neutral" : (arming?.phase ?? "hold");
    const title = deck.arming[phase] ?? deck.arming["hold"];
    return { id: "arming", title, progress: arming?.progress ?? 0 };
  }
  return route?.phase === "planned" ? follow(route, false) : { id: "speed" };
}

function follow(route: RouteState, isHeld: boolean): Step {
  const { deck } = texts();
  const [length, done] = [figure(route.length_m, 1), figure(route.done_m, 1)];
  if (isHeld)
    return {
      id: "going",
      title: deck.going(done, length),
      progress: route.done_m / Math.max(route.length_m, 1e-6),
      path: true,
    };
  return {
    id: "path",
    title: deck.path,
    detail: deck.goThen(length, duration(route.time_s)),
    path: true,
  };
}

function withoutControl(session: Session, state: RobotState): Step {
  const { link } = session;
  const { deck } = texts();
  const { lease } = state.status;
  const me = link.welcome.value?.operator;
  if (lease.holder !== null && lease.requested_by === me) {
    const name = nameOf(lease.holder);
    return {
      id: "waiting",
      title: deck.asked(name),
      name,
      detail: deck.waiting(duration(Math.ceil(lease.request_expires_in_s))),
      quiet: { text: deck.withdraw, does: { t: "lease", op: "withdraw" } },
    };
  }
  const op = lease.holder === null ? "acquire" : "request";
  const asker = lease.requested_by;
  const refused: Refusal | null =
    asker === null
      ? whyNotTakeControl(link)
      : { by: "robot", reason: { code: "other_request", params: { asker } } };
  const next: Action = {
    text: lease.holder === null ? deck.take : deck.ask,
    does: { t: "lease", op, ...controlTerms(link) },
    refused,
  };
  if (isLatched(link)) return { ...latched(session, state), next };
  if (lease.holder !== null) return { ...driver(session, state), next };
  const title = lease.reserved_for === me ? deck.keptForYou : deck.free;
  return { id: "free", title, detail: deck.freeThen, next };
}

/** Who drives, and how fast. */
function driver(session: Session, { status }: RobotState): Step {
  const { deck } = texts();
  if (status.lease.holder === null) return { id: "free", title: deck.free };
  const name = nameOf(status.lease.holder);
  const { value, unit } = speedOf(session);
  const moves = status.mode === "driving" || status.mode === "stopping";
  const title = moves ? deck.drives(name, `${figure(value, 2)} ${unit}`) : deck.holds(name);
  return { id: "other", title, name };
}

/** Who or what has stopped the robot, and when. */
function latched(session: Session, { status, mode_age_s }: RobotState): Step {
  const { deck, common } = texts();
  const { stop, mode } = status;
  const detail = deck.ago(duration(mode_age_s));
  const by = stop?.code === "stop_requested" && !stop.cause ? stop.params?.["by"] : undefined;
  if (by === undefined)
    return { id: mode, title: stop ? sentence(stop).slice(0, -1) : common.modes[mode], detail };
  if (by === session.link.welcome.value?.operator)
    return { id: mode, title: deck.youStopped, detail };
  const name = nameOf(String(by));
  return { id: mode, title: deck.stoppedBy(name), name, detail };
}

/** Why the controls do not act now, or null; and in short, when they will. */
export function whyOff(session: Session): { text: string; short: string | null } | null {
  const { link } = session;
  const { deck } = texts();
  void link.beat.value;
  const refusal = whyNotDrive(link);
  if (refusal === null) return null;
  const isLive = freshness(link).kind === "live";
  const short = isLatched(link) ? deck.afterReset : deck.whenArmed;
  const waits = !ARMED.has(link.state.value?.status.mode ?? "");
  return { text: refusalText(refusal), short: isLive && waits ? short : null };
}
