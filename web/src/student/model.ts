// Setting of the Student tab, its link, and the requests for what follows from it. The dashboard
// computes that without a robot.

import { effect, signal } from "@preact/signals";
import type { StudentReply } from "../generated/wire";
import type { Link } from "../store/link";

const ASK_EVERY_MS = 80; // The server accepts 20 per second.
const GIVE_UP_MS = 1500; // Retry a request without a response after this time.
const DEFAULT_BASE = "tsd";
const DEFAULT_TWIST: Triple = [0.5, 0, 0];

export type Triple = [number, number, number];

export interface Setting {
  base: string;
  /** Changed numbers of the description, by key. */
  knobs: Readonly<Record<string, number>>;
  twist: Triple;
  /** Joints that replace the twist: for each module α and β in degrees and rpm, for each wheel rpm. */
  joints: readonly (readonly number[])[] | null;
}

/** Return the setting in a query string, or null. */
export function settingOf(query: string): Setting | null {
  const parameters = new URLSearchParams(query);
  const base = parameters.get("student");
  if (base === null) return null;
  const knobs: Record<string, number> = {};
  for (const [key, text] of parameters) {
    const value = numberOf(text);
    if (key.includes(".") && value !== null) knobs[key] = value;
  }
  const [a = null, b = null, c = null, ...more] = numbersOf(parameters.get("twist") ?? "");
  const isTwist = more.length === 0 && a !== null && b !== null && c !== null;
  const rows = (parameters.get("joints") ?? "").split("~").map(numbersOf);
  const isJoints = rows.every((row) => row.every((value) => value !== null));
  return {
    base,
    knobs,
    twist: isTwist ? [a, b, c] : DEFAULT_TWIST,
    joints: isJoints ? (rows as number[][]) : null,
  };
}

/** Return an address with the setting: robot, numbers that differ from it, twist or joints. */
export function linkTo({ base, knobs, twist, joints }: Setting, address: string): string {
  const url = new URL(address);
  url.search = url.hash = ""; // Other parameters of the page are not shared.
  url.searchParams.set("student", base);
  for (const [key, value] of Object.entries(knobs)) url.searchParams.set(key, String(value));
  if (joints === null) url.searchParams.set("twist", twist.join("_"));
  else url.searchParams.set("joints", joints.map((row) => row.join("_")).join("~"));
  return url.href;
}

function numbersOf(text: string): (number | null)[] {
  return text.split("_").map(numberOf);
}

function numberOf(text: string): number | null {
  const value = Number(text);
  return text.trim() === "" || !Number.isFinite(value) ? null : value;
}

export class StudentModel {
  readonly setting;
  readonly reply = signal<StudentReply | null>(null);
  /** Called with the requested description. */
  onToml: (base: string, toml: string) => void = () => {};
  #shown = false;
  #number = 0;
  #isSent = false; // The latest setting has been requested.
  #isAsking = false;
  #askedMs = -Infinity;
  #wantsToml = false;
  #timer = 0;
  readonly #link: Link;

  /** `query` is the query string of the page's address. */
  constructor(link: Link, query: string) {
    const initial = { base: DEFAULT_BASE, knobs: {}, twist: DEFAULT_TWIST, joints: null };
    this.setting = signal<Setting>(settingOf(query) ?? initial);
    this.#link = link;
    link.on("student", (reply) => this.#take(reply));
    link.on("welcome", () => this.#forget());
    effect(() => {
      if (link.beat.value > 0 && this.#shown) this.#refresh();
    });
  }

  /** Compute while the tab is shown, and show the robot of the setting in the scene. */
  show(shown: boolean): void {
    this.#shown = shown;
    this.#changed();
  }

  choose(base: string): void {
    this.#set({ base, knobs: {}, joints: null });
  }

  /** Set a number of the description; its default value counts as unchanged. */
  turn(key: string, value: number): void {
    const usual = this.reply.peek()?.knobs.find((knob) => knob.key === key)?.usual;
    const knobs = { ...this.setting.peek().knobs, [key]: value };
    if (value === usual) delete knobs[key];
    this.#set({ knobs });
  }

  /** Set a component of the twist, from which the joints follow. */
  move(axis: number, value: number): void {
    const solved = this.reply.peek()?.figures;
    const { joints, twist } = this.setting.peek();
    const before = joints !== null && solved ? solved.twist : twist;
    const moved = before.map((old, i) => (i === axis ? value : old)) as Triple;
    this.#set({ twist: moved, joints: null });
  }

  /** Set one joint of a wheel and compute the twist; other joints keep their values. */
  bend(wheel: number, joint: number, value: number): void {
    const rows = this.setting.peek().joints ?? this.joints();
    const bent = rows.map((row, i) =>
      i === wheel ? row.map((old, j) => (j === joint ? value : old)) : row,
    );
    this.#set({ joints: bent });
  }

  /** Joints of the latest reply. */
  joints(): number[][] {
    const wheels = this.reply.value?.figures?.wheels ?? [];
    return wheels.map(({ gimbal, rpm }) => (gimbal ? [gimbal[0], gimbal[1], rpm] : [rpm]));
  }

  /** Address that opens the page with this setting. */
  link(): string {
    return linkTo(this.setting.peek(), location.href);
  }

  reset(): void {
    this.#set({ knobs: {}, twist: DEFAULT_TWIST, joints: null });
  }

  /** Request the description as a file, which comes with the reply. */
  requestToml(): void {
    this.#wantsToml = true;
    this.#changed();
  }

  #set(change: Partial<Setting>): void {
    this.setting.value = { ...this.setting.peek(), ...change };
    this.#changed();
  }

  /** Request the results unless known; called while they are shown. */
  #refresh(): void {
    if (performance.now() - this.#askedMs > GIVE_UP_MS) this.#forget();
    if (!this.#isSent) this.#ask();
  }

  /** A request in flight will get no response. */
  #forget(): void {
    if (this.#isAsking) this.#isAsking = this.#isSent = false;
  }

  #changed(): void {
    this.#isSent = false;
    this.#ask();
  }

  #ask(): void {
    if (this.#isAsking || this.#timer !== 0) return; // The latest setting is requested next.
    const waitMs = this.#askedMs + ASK_EVERY_MS - performance.now();
    if (waitMs > 0) {
      this.#timer = window.setTimeout(() => {
        this.#timer = 0;
        this.#ask();
      }, waitMs);
      return;
    }
    this.#number += 1;
    this.#askedMs = performance.now();
    const { base, knobs, twist, joints } = this.setting.peek();
    this.#isSent = this.#isAsking = this.#link.send({
      t: "student",
      number: this.#number,
      base,
      knobs,
      twist,
      joints: joints?.map((row) => [...row]) ?? null,
      toml: this.#wantsToml,
      papers: true,
      show: this.#shown,
    });
  }

  #take(reply: StudentReply): void {
    if (reply.number !== this.#number) return; // Reply to an abandoned request.
    this.#isAsking = false;
    if (reply.toml !== null) this.onToml(reply.base, reply.toml);
    if (reply.toml !== null || reply.problem !== "") this.#wantsToml = false;
    // Results stay while a setting is impossible.
    const figures = reply.figures ?? this.reply.peek()?.figures ?? null;
    this.reply.value = { ...reply, figures };
    if (!this.#isSent) this.#ask();
  }
}
