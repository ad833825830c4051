// Slot left of STOP: one sentence, and the next step. Evaluated in one place, so that no two
// states claim the place and each state is a row in the tests.

import { isOnFloor } from "../drive/axes";
import type { RobotState, RouteState } from "../generated/wire";
import type { Session } from "../session";
import { freshness } from "../store/freshness";
import type { Link } from "../store/link";
import { isLatched, isMoving, type Refusal } from "../store/permission";
import { whyNot, whyNotDrive, whyNotTakeControl } from "../store/permission";
import { controlTerms, type Request } from "../store/requests";
import { nameOf, refusalText, sentence } from "../text/reasons";
import { duration, figure, texts } from "../text/text";
import { clock } from "../timeline/clock";
import { backToLive } from "../timeline/library";

const ARMED = ["ready", "driving", "stopping"];

export interface Action {
  text: string;
  does: Request | (() => void);
  refused?: Refusal | null;
  hold?: boolean;
  key?: string;
}

export interface Step {
  id: string;
  title?: string;
  /** Operator's name in the title. */
  name?: string;
  detail?: string;
  progress?: number;
  /** The filled button, and the quiet one next to it. */
  next?: Action;
  quiet?: Action;
  /** Whether the next step is to hold the path. */
  path?: boolean;
}

export function unitOf(link: Link): "m/s" | "rad/s" {
  return isOnFloor(link.robot.value) ? "m/s" : "rad/s";
}

/** Speed, or the rate of rolling for a sphere. */
export function speedOf(link: Link): number | null {
  const twist = link.state.value?.twist;
  return twist ? Math.hypot(twist[0], twist[1]) : null;
}

/** Return the step for the state of robot and page; it follows all signals that it depends on. */
export function stepOf(session: Session): Step {
  const { library, link, stop } = session;
  const { deck, common, timeline } = texts();
  if (stop.unconfirmed.value) {
    const quiet = { text: deck.acknowledge, does: () => stop.acknowledge() };
    return { id: "unconfirmed", title: deck.unconfirmed, detail: deck.unconfirmedThen, quiet };
  }
  if (library.isMissing.value) {
    const next = { text: deck.live, does: backToLive, key: "L" };
    return { id: "missing", title: timeline.refusals["no_recording"]!, next };
  }
  const fresh = freshness(link);
  const state = link.state.value;
  if (fresh.kind === "offline" || fresh.kind === "silent") {
    const title = deck[fresh.kind](duration(fresh.forMs / 1000));
    return { id: fresh.kind, title, detail: deck.reconnecting };
  }
  if (fresh.kind === "no_robot") return { id: "no_robot", title: common.refusals["no_robot"] };
  if (fresh.kind === "recorded" && fresh.by === "page") return past(session);
  if (fresh.kind === "recorded") return { id: "replay", title: common.refusals["replay_shown"] };
  if (fresh.kind === "starting" || state === null) return { id: "starting" };
  if (link.welcome.value?.role === "viewer")
    return { ...driver(link, state), id: "viewer", detail: common.refusals["viewer_only"] };
  return state.has_control ? withControl(session, state) : withoutControl(link, state);
}

/** The time looked at, what the robot itself does now, and the way back. */
function past({ link, fleet, playback }: Session): Step {
  const { deck, common } = texts();
  const shownMs = playback.shownMs.value;
  const id = link.robot.value?.id;
  const now = fleet.rows.value.find((row) => row.id === id && row.source === "robot");
  const mode = common.modes[now?.mode ?? ""];
  const driver = now?.driver ? (now.operators[now.driver] ?? nameOf(now.driver)) : null;
  const known = now?.silent || mode === undefined ? deck.gone : deck.now(mode, driver);
  return {
    id: "past",
    title: shownMs === null ? "" : deck.past(clock(shownMs)),
    detail: now && known,
    next: { text: deck.live, does: backToLive, key: "L" },
  };
}

/** A state about an operator, whose name is part of the title. */
function about(operator: string, id: string, title: (name: string) => string): Step {
  const name = nameOf(operator);
  return { id, title: title(name), name };
}

function withControl({ link, path }: Session, state: RobotState): Step {
  const { deck } = texts();
  const { mode, lease, arming } = state.status;
  const { panel, modules = [] } = link.robot.value ?? {};
  const route = path.route.value;
  // Checked first, because removing its button would release it.
  if (path.going.value && route) return going(route);
  if (lease.requested_by !== null) {
    const requester = lease.requested_by;
    return {
      ...about(requester, "asked", deck.asks),
      detail: deck.asksThen(duration(Math.ceil(lease.request_expires_in_s))),
      next: { text: deck.handOver, does: { t: "lease", op: "grant", requester } },
      quiet: { text: deck.keep, does: { t: "lease", op: "deny", requester } },
    };
  }
  if (isLatched(link)) {
    const refused = whyNot(link, "reset");
    const next: Action = { text: deck.reset, does: { t: "reset" }, hold: true, refused };
    return { ...latched(link, state), next };
  }
  if (mode === "disarmed") {
    const detail = deck.armThen[panel === "gimbals" || panel === "twist" ? panel : "other"];
    const next: Action = { text: deck.arm, does: { t: "arm" }, refused: whyNot(link, "arm") };
    return { id: "disarmed", title: deck.yours, detail, next };
  }
  if (mode === "arming") {
    const phase = arming?.phase ?? "hold";
    const title = deck.arming[phase === "hold" && modules.length > 0 ? "neutral" : phase];
    return { id: "arming", title: title ?? deck.arming["hold"], progress: arming?.progress ?? 0 };
  }
  if (route?.phase !== "planned") return { id: "speed" };
  return { id: "path", title: deck.path, path: true };
}

function going({ length_m, done_m }: RouteState): Step {
  const title = texts().deck.going(figure(done_m, 1), figure(length_m, 1));
  return { id: "going", title, progress: done_m / Math.max(length_m, 1e-6), path: true };
}

function withoutControl(link: Link, state: RobotState): Step {
  const { deck } = texts();
  const { holder, requested_by: asker, reserved_for, request_expires_in_s } = state.status.lease;
  const me = link.welcome.value?.operator;
  if (holder !== null && asker === me)
    return {
      ...about(holder, "waiting", deck.asked),
      detail: deck.waiting(duration(Math.ceil(request_expires_in_s))),
      quiet: { text: deck.withdraw, does: { t: "lease", op: "withdraw" } },
    };
  const next: Action = {
    text: holder === null ? deck.take : deck.ask,
    does: { t: "lease", op: holder === null ? "acquire" : "request", ...controlTerms(link) },
    refused:
      asker === null
        ? whyNotTakeControl(link)
        : { by: "robot", reason: { code: "other_request", params: { asker } } },
  };
  if (isLatched(link)) return { ...latched(link, state), next };
  if (holder !== null) return { ...driver(link, state), next };
  const title = reserved_for === me ? deck.keptForYou : deck.free;
  return { id: "free", title, detail: deck.freeThen, next };
}

function driver(link: Link, { status }: RobotState): Step {
  const { deck } = texts();
  if (status.lease.holder === null) return { id: "free", title: deck.free };
  const speed = `${figure(speedOf(link), 2)} ${unitOf(link)}`;
  const drives = (name: string) => deck.drives(name, speed);
  return about(status.lease.holder, "other", isMoving(link) ? drives : deck.holds);
}

function latched(link: Link, { status, mode_age_s }: RobotState): Step {
  const { deck, common } = texts();
  const { stop, mode } = status;
  const detail = deck.ago(duration(mode_age_s));
  const by = stop?.code === "stop_requested" && !stop.cause ? stop.params?.["by"] : undefined;
  const title = stop ? `${sentence(stop).slice(0, -1)},` : common.modes[mode];
  if (by === undefined) return { id: mode, title, detail };
  if (by === link.welcome.value?.operator) return { id: mode, title: deck.youStopped, detail };
  return { ...about(String(by), mode, deck.stoppedBy), detail };
}

/** Why the controls do not act now, or null; and in short, when they will. */
export function whyOff({ link }: Session): { text: string; short: string | null } | null {
  const { deck } = texts();
  const refusal = whyNotDrive(link);
  if (refusal === null) return null;
  const isLive = freshness(link).kind === "live";
  const waits = isLive && !ARMED.includes(link.state.value?.status.mode ?? "");
  const short = isLatched(link) ? deck.afterReset : deck.whenArmed;
  return { text: refusalText(refusal), short: waits ? short : null };
}
