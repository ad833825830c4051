// The one notice below the view buttons, and what it tells: unrequested changes, each once.

import { effect, signal, untracked } from "@preact/signals";
import type { Ended } from "../drive/drive";
import type { Reason, RobotEvent } from "../generated/wire";
import type { Session } from "../session";
import { isNotable, isToldElsewhere, noticeOf, noticeOfRefusal } from "../text/notices";
import { plain, retry, type Told } from "../text/notices";
import { refusalText, sentence } from "../text/reasons";
import { texts } from "../text/text";
import type { Link } from "./link";
import { keep, recall } from "./memory";
import { isLatched, isMoving, stillHolds, whyNotDrive } from "./permission";

const SHOWN_MS = 6000;
const READ_MS = 2000; // Shortest time, also if its cause is gone.

/** A notice is gone with its cause, or after it could be read. */
export class Notice {
  readonly text = signal<string | null>(null);
  #sinceMs = 0;
  #holds: () => boolean = () => true;

  constructor(link: Link) {
    link.on("robot", () => this.clear());
    effect(() => {
      if (link.beat.value >= 0 && this.text.value !== null) untracked(() => this.#check());
    });
  }

  /** Show `text` in place of the notice before it, while `holds` returns true. */
  say(text: string, holds: () => boolean = () => true): void {
    this.#sinceMs = performance.now();
    this.#holds = holds;
    this.text.value = text;
  }

  clear(): void {
    this.text.value = null;
  }

  #check(): void {
    const ageMs = performance.now() - this.#sinceMs;
    if (ageMs > SHOWN_MS || (ageMs > READ_MS && !this.#holds())) this.clear();
  }
}

/** Page, server and robot may all report one fact within this time. */
const TOLD_MS = 1000;
/** Requests whose answers `Requests` follows, and STOP, whose answers are shown on its button. */
const FOLLOWED = new Set(["lease", "arm", "disarm", "reset", "wheel_speed", "stop"]);
/** Time in ms at which this tab was left while the robot moved, which stopped it. */
const LEFT = "tsd-left-in-motion-ms";
const LONGEST_LOAD_MS = 20_000;

export class News {
  #endedMs = -Infinity;
  #controlMs = -Infinity;
  #takenMs = -Infinity;
  #again: string | null = null;

  constructor(private readonly session: Session) {
    const { link, drive, stop, requests } = session;
    link.on("event", (event) => this.#onEvent(event));
    link.on("reply", ({ to, ok, why }) => {
      if (!ok && !FOLLOWED.has(to)) this.#onRefused(why);
      if (ok && to === "stop" && link.recording !== null)
        this.#tell(plain(texts().bar.news.liveStopped));
    });
    drive.onEnded = (ended) => this.#onEnded(ended);
    stop.onRefused = (refusal) => this.#tell(plain(refusalText(refusal)));
    requests.onFailed = (why) => this.#onRefused(why);
    effect(() => {
      if (drive.held.value && !drive.looksOnly.value) untracked(() => this.#onPushed());
    });
    this.#tellOfReload();
  }

  #onRefused(why: Reason | null): void {
    this.#tell(plain(why ? sentence(why) : texts().bar.news.refused));
  }

  #onEvent(event: RobotEvent): void {
    const { link } = this.session;
    if (event.past || !isNotable(event, link.welcome.peek()?.operator)) return;
    const nowMs = performance.now();
    // A take-over includes its reason, so the loss is not reported again.
    if (event.why.code === "lease_taken_over") this.#takenMs = nowMs;
    else if (event.kind === "lease" && nowMs - this.#takenMs < TOLD_MS) return;
    if (event.kind === "lease") this.#controlMs = -Infinity; // It is more specific than all others.
    const told = noticeOf(event, link.state.peek()?.has_control ?? false);
    this.#tell(told, () => event.kind !== "mode" || !isLatched(link));
  }

  #onEnded(ended: Ended): void {
    const { link } = this.session;
    const before = isLatched(link);
    // Hide advice once the robot is latched, since the deck has the details then.
    const advises = () => before || !isLatched(link);
    if ("lost" in ended) {
      this.#tell(plain(texts().bar.news.connectionLost), () => !link.connected.value);
    } else if ("released" in ended) {
      if (!isToldElsewhere(ended.released)) this.#tell(retry(ended.released), advises);
    } else {
      const { refusal, atStart } = ended;
      const told = atStart ? plain(refusalText(refusal)) : noticeOfRefusal(refusal);
      if (told) this.#tell(told, () => stillHolds(refusal, whyNotDrive(link)) && advises());
    }
  }

  #tell({ text, again, control }: Told, holds?: () => boolean): void {
    const nowMs = performance.now();
    if (again && nowMs - this.#endedMs < TOLD_MS) return;
    if (control && nowMs - this.#controlMs < TOLD_MS) return;
    if (again) this.#endedMs = nowMs;
    if (control) this.#controlMs = nowMs;
    this.#again = again ? text : null;
    this.session.notice.say(text, holds);
  }

  /** "Push again" is done: the robot drives, so the notice would be false. */
  #onPushed(): void {
    const { notice } = this.session;
    if (this.#again !== null && notice.text.peek() === this.#again) notice.clear();
    this.#again = null;
  }

  #tellOfReload(): void {
    const { link, drive } = this.session;
    const leave = () => {
      const moves = link.state.peek()?.has_control && isMoving(link);
      if (drive.held.peek() || moves) keep(LEFT, Date.now(), "sessionStorage");
    };
    addEventListener("pagehide", leave, { capture: true }); // Before the controls are released.
    const isFresh = (ms: unknown): ms is number => Date.now() - Number(ms) < LONGEST_LOAD_MS;
    if (recall(LEFT, isFresh, "sessionStorage") === null) return;
    keep(LEFT, null, "sessionStorage");
    const end = link.on("robot", () => {
      end();
      this.#tell(plain(texts().bar.news.reloaded));
    });
  }
}
