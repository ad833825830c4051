// Setting of the Student tab, its link, and the requests for its results. The dashboard
// computes that without a robot.

import { effect, signal } from "@preact/signals";
import type { StudentReply, StudentRequest } from "../generated/wire";
import type { Link } from "../store/link";

const ASK_EVERY_MS = 80; // The server accepts 20 per second.
const GIVE_UP_MS = 1500; // Retry a request without a response after this time.
const DEFAULT_TWIST: Triple = [0.5, 0, 0];
const DEFAULT: Setting = { base: "tsd", knobs: {}, twist: DEFAULT_TWIST, joints: null };

export type Triple = [number, number, number];

export type Setting = Required<Pick<StudentRequest, "base" | "knobs" | "twist" | "joints">>;

/** Return the setting in a query string, or null. */
export function settingOf(query: string): Setting | null {
  const parameters = new URLSearchParams(query);
  const base = parameters.get("student");
  if (base === null) return null;
  const numbers = [...parameters].map(([key, text]) => [key, numberOf(text)] as const);
  const knobs = numbers.filter(([key, value]) => key.includes(".") && Number.isFinite(value));
  const rows = (name: string) =>
    (parameters.get(name) ?? "").split("~").map((row) => row.split("_").map(numberOf));
  const [twist, joints] = [rows("twist").flat(), rows("joints")];
  const isTwist = twist.length === 3 && twist.every(Number.isFinite);
  return {
    base,
    knobs: Object.fromEntries(knobs),
    twist: isTwist ? (twist as Triple) : DEFAULT_TWIST,
    joints: joints.flat().every(Number.isFinite) ? joints : null,
  };
}

const numberOf = (text: string) => (text.trim() === "" ? NaN : Number(text));

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

export class StudentModel {
  readonly setting;
  readonly reply = signal<StudentReply | null>(null);
  /** Called with the requested description. */
  onToml: (base: string, toml: string) => void = () => {};
  #shown = false;
  #number = 0;
  #isDue = false; // The latest setting has not been requested.
  #isAsking = false;
  #askedMs = -Infinity;
  #wantsToml = false;
  #pause = 0; // Timer that runs after a request.

  constructor(
    private readonly link: Link,
    query: string,
  ) {
    this.setting = signal(settingOf(query) ?? DEFAULT);
    link.on("student", (reply) => this.#take(reply));
    link.on("welcome", () => this.#forget());
    effect(() => {
      if (link.beat.value === 0 || !this.#shown) return;
      if (performance.now() - this.#askedMs > GIVE_UP_MS) this.#forget();
      this.#ask();
    });
  }

  /** Compute while the tab is shown, and show the robot of the setting in the scene. */
  show(shown: boolean): void {
    this.#shown = shown;
    this.#askAgain();
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
    const { joints, twist } = this.setting.peek();
    const solved = this.reply.peek()?.figures?.twist;
    const before = joints === null ? twist : (solved ?? twist);
    this.#set({ twist: before.with(axis, value) as Triple, joints: null });
  }

  /** Set one joint of a wheel and compute the twist; other joints keep their values. */
  bend(wheel: number, joint: number, value: number): void {
    const rows = this.joints();
    this.#set({ joints: rows.with(wheel, rows[wheel]!.with(joint, value)) });
  }

  /** Joints of the setting, or of the latest reply if they follow from the twist. */
  joints(): number[][] {
    const wheels = this.reply.value?.figures?.wheels ?? [];
    const solved = wheels.map(({ gimbal, rpm }) => [...(gimbal?.slice(0, 2) ?? []), rpm]);
    return this.setting.value.joints ?? solved;
  }

  reset(): void {
    this.#set({ ...DEFAULT, base: this.setting.peek().base });
  }

  /** Request the description as a file, which comes with the reply. */
  requestToml(): void {
    this.#wantsToml = true;
    this.#askAgain();
  }

  #set(change: Partial<Setting>): void {
    this.setting.value = { ...this.setting.peek(), ...change };
    this.#askAgain();
  }

  #askAgain(): void {
    this.#isDue = true;
    this.#ask();
  }

  /** A request in flight will get no response. */
  #forget(): void {
    this.#isDue ||= this.#isAsking;
    this.#isAsking = false;
  }

  /** Request the latest setting unless that was done; the response or the pause comes first. */
  #ask(): void {
    if (!this.#isDue || this.#isAsking || this.#pause !== 0) return;
    this.#number += 1;
    this.#askedMs = performance.now();
    this.#isAsking = this.link.send({
      t: "student",
      number: this.#number,
      ...this.setting.peek(),
      toml: this.#wantsToml,
      papers: true,
      show: this.#shown,
    });
    if (!this.#isAsking) return;
    this.#isDue = false;
    this.#pause = window.setTimeout(() => {
      this.#pause = 0;
      this.#ask();
    }, ASK_EVERY_MS);
  }

  #take(reply: StudentReply): void {
    if (reply.number !== this.#number) return; // Reply to an abandoned request.
    this.#isAsking = false;
    if (reply.toml !== null) this.onToml(reply.base, reply.toml);
    if (reply.toml !== null || reply.problem !== "") this.#wantsToml = false;
    // Results stay while a setting is impossible.
    const figures = reply.figures ?? this.reply.peek()?.figures ?? null;
    this.reply.value = { ...reply, figures };
    this.#ask();
  }
}
