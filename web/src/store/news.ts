// Notices of unrequested changes, each shown once.

import { effect, untracked } from "@preact/signals";
import { type Drive, type Ended, isMoving, stillRefused } from "../drive/drive";
import type { Stop } from "../drive/stop";
import type { RobotEvent } from "../generated/wire";
import { isNotable, isToldElsewhere, noticeOf, noticeOfRefusal } from "../text/notices";
import { plain, retry, type Told } from "../text/notices";
import { refusalText, sentence } from "../text/reasons";
import { texts } from "../text/text";
import type { Link } from "./link";
import type { Notice } from "./notice";
import { isLatched } from "./permission";
import type { Requests } from "./requests";

/** Page, server and robot may all report one fact within this time. */
const TOLD_MS = 1000;
/** Requests whose answers `Requests` follows, and STOP, whose answers are shown on its button. */
const FOLLOWED = new Set(["lease", "arm", "disarm", "reset", "wheel_speed", "stop"]);

interface Parts {
  link: Link;
  drive: Drive;
  stop: Stop;
  notice: Notice;
  requests: Requests;
}

export class News {
  readonly #parts: Parts;
  #endedMs = -Infinity;
  #controlMs = -Infinity;
  #takenMs = -Infinity;
  #again: string | null = null;

  constructor(parts: Parts) {
    this.#parts = parts;
    const { link, drive, stop, requests } = parts;
    link.on("event", (event) => this.#onEvent(event));
    link.on("reply", ({ to, ok, why }) => {
      const { news } = texts().bar;
      if (!ok && !FOLLOWED.has(to)) this.#tell(plain(why ? sentence(why) : news.refused));
      if (ok && to === "stop" && link.recording !== null) this.#tell(plain(news.liveStopped));
    });
    drive.onEnded = (ended) => this.#onEnded(ended);
    stop.onRefused = (refusal) => this.#tell(plain(refusalText(refusal)));
    requests.onFailed = (_, outcome) => {
      const why = outcome === "no_answer" ? { code: "no_answer" } : outcome.why;
      this.#tell(plain(why ? sentence(why) : texts().bar.news.refused));
    };
    effect(() => {
      if (drive.held.value && !drive.looksOnly.value) untracked(() => this.#onPushed());
    });
    this.#noteReload();
  }

  #onEvent(event: RobotEvent): void {
    const { link } = this.#parts;
    if (event.past || !isNotable(event, link.welcome.peek()?.operator)) return;
    const nowMs = performance.now();
    // A take-over includes its reason, so the loss is not reported again.
    if (event.why.code === "lease_taken_over") this.#takenMs = nowMs;
    else if (event.kind === "lease" && nowMs - this.#takenMs < TOLD_MS) return;
    const told = noticeOf(event, link.state.peek()?.has_control ?? false);
    if (event.kind === "lease") this.#controlMs = -Infinity; // It says more than all others.
    this.#tell(told, () => event.kind !== "mode" || !isLatched(link));
  }

  #onEnded(ended: Ended): void {
    const { link } = this.#parts;
    const { news } = texts().bar;
    if ("lost" in ended) {
      this.#tell(plain(news.connectionLost), () => !link.connected.value);
    } else if ("released" in ended) {
      if (!isToldElsewhere(ended.released))
        this.#tell(retry(ended.released), this.#unlessLatched());
    } else {
      const { refusal, atStart } = ended;
      const told = atStart ? plain(refusalText(refusal)) : noticeOfRefusal(refusal);
      const holds = this.#unlessLatched();
      if (told) this.#tell(told, () => stillRefused(link, refusal) && holds());
    }
  }

  /** Hide advice once the robot is latched, since the deck has the details then. */
  #unlessLatched(): () => boolean {
    const { link } = this.#parts;
    const before = isLatched(link);
    return () => before || !isLatched(link);
  }

  #tell({ text, again, control }: Told, holds: () => boolean = () => true): void {
    const nowMs = performance.now();
    if (again && nowMs - this.#endedMs < TOLD_MS) return;
    if (control && nowMs - this.#controlMs < TOLD_MS) return;
    if (again) this.#endedMs = nowMs;
    if (control) this.#controlMs = nowMs;
    this.#again = again ? text : null;
    this.#parts.notice.say(text, holds);
  }

  /** "Push again" is done: the robot drives, so the notice would be false. */
  #onPushed(): void {
    const { notice } = this.#parts;
    if (this.#again !== null && notice.text.peek() === this.#again) notice.clear();
    this.#again = null;
  }

  /** Tell the next page of this tab that it was loaded while the robot moved, which stopped it. */
  #noteReload(): void {
    const { link, drive } = this.#parts;
    const leave = () => {
      const state = link.state.peek();
      if (drive.held.peek() || (state?.has_control && isMoving(state))) leaveNote();
    };
    addEventListener("pagehide", leave, { capture: true }); // Before the controls are released.
    if (!takeNote()) return;
    const end = link.on("robot", () => {
      end();
      this.#tell(plain(texts().bar.news.reloaded));
    });
  }
}

const NOTE = "tsd-left-in-motion-ms";
const FRESH_MS = 20_000;

function leaveNote(): void {
  try {
    sessionStorage.setItem(NOTE, String(Date.now()));
  } catch {
    // Without storage, the robot's events show it.
  }
}

function takeNote(): boolean {
  try {
    const ageMs = Date.now() - Number(sessionStorage.getItem(NOTE) ?? NaN);
    sessionStorage.removeItem(NOTE);
    return ageMs < FRESH_MS;
  } catch {
    return false;
  }
}
