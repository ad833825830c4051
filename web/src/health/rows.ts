// Readings of the robot and the link to it, each judged by its band where it has one.

import type { RobotInfo, RobotState, RobotStatus, ShadowReport } from "../generated/wire";
import { quantityOf } from "../plots/fields";
import { STALE_MS } from "../store/freshness";
import type { Link } from "../store/link";
import { FAIR, FAIR_LOSS, GOOD, GOOD_LOSS, jitterMs, quality, roundTripMs } from "../store/quality";
import { sentence } from "../text/reasons";
import { degrees, figure, language, texts } from "../text/text";

/** 0: fine, or without a band; 1: look at it; 2: do not drive on. */
export type Level = 0 | 1 | 2;

export interface Band {
  /** Limits of the readings that are fine. */
  least: number;
  most: number;
  /** Ends of the drawn scale. */
  from: number;
  to: number;
  /** Reading, or null if unknown. */
  at: number | null;
}

export interface Row {
  name: string;
  value: string;
  unit: string;
  band: Band | null;
  level: Level;
  /** What it means and what to do, outside the band. */
  remedy: string;
}

type Words = ReturnType<typeof texts>["health"];
export type GroupKey = keyof Words["groups"];
export type Groups = Partial<Record<GroupKey, Row[]>>;
type RowKey = keyof Words["rows"];

const LOOP_HZ = { least: 95, most: 105, from: 50, to: 150 }; // PERIOD_S of node/robot_node.py.
const LOOP_JITTER_MS = 5; // Half a period.
const HOT_C = 70; // HOT_C of control/monitors.py.
const COUNTED = new Set(["missed", "broken", "reconnects"]); // Errors of serial lines.
const LOW_BATTERY = "battery_low"; // Its own row shows it.
const RECENT_S = 10;

/** Recent increase of counters, since a counter alone only shows that something happened once. */
export class Increases {
  #counts = new Map<string, { ms: number; count: number }[]>();

  /** Note a counter now, and return its increase in the last seconds; after a restart, zero. */
  of(name: string, count: number): number {
    const ms = performance.now();
    const before = this.#counts.get(name) ?? [];
    const kept = before.filter((each) => ms - each.ms <= 1000 * RECENT_S && each.count <= count);
    this.#counts.set(name, [...kept, { ms, count }]);
    return count - (kept[0]?.count ?? count);
  }
}

/** Return the rows of all groups that this robot has; counters refer to the last seconds. */
export function rowsOf(link: Link, state: RobotState, isLive: boolean, recent: Increases): Groups {
  const { status, shadow } = state;
  const { loop, limits, hardware } = status;
  const { dropped } = status.command;
  const robot = link.robot.peek();
  return {
    ...(isLive ? { link: linkRows(link, state) } : {}),
    loop: [
      reading("rate", loop.hz, 1, "Hz", LOOP_HZ),
      reading("loopJitter", loop.jitter_p99_ms, 1, "ms", { most: LOOP_JITTER_MS, to: 20 }),
      count("overruns", recent.of("overruns", loop.overruns)),
    ],
    estimate: [...estimateRows(robot, state, recent)],
    hardware: hardwareRows(status, hardware, recent),
    commands: [
      count("dropped", recent.of("dropped", sum(dropped)), reasons(dropped)),
      plain(texts().health.rows.droppedAll, reasons(dropped)),
      reading("ageLimit", 1000 * limits.max_command_age_s, 0, "ms"),
    ],
    control: controlRows(status, robot),
    ...(shadow ? { shadow: [...shadowRows(shadow)] } : {}),
  };
}

function plain(name: string, value: string, unit = ""): Row {
  return { name, value, unit, band: null, level: 0, remedy: "" };
}

interface Limits extends Omit<Partial<Band>, "at"> {
  most: number;
  to: number;
  level?: Level;
  /** Object named in the remedy; by default, the limit. */
  about?: string;
}

function reading(
  key: RowKey,
  value: number | null,
  decimals: number,
  unit: string,
  limits?: Limits,
): Row {
  const row = plain(texts().health.rows[key], figure(value, decimals), unit);
  if (!limits) return row;
  const { least = -Infinity, most, from = 0, to, level = 1, about } = limits;
  const band = { least, most, from, to, at: value };
  if (value === null || (value >= least && value < most)) return { ...row, band };
  const limit = value < least ? least : most;
  const text = `${figure(limit, Number.isInteger(limit) ? 0 : decimals)} ${unit}`;
  return { ...row, band, level, remedy: remedyOf(key, about ?? text) };
}

/** A fact without a scale that is wrong or not. */
function fact(key: RowKey, value: string, level: Level, about = ""): Row {
  const row = plain(texts().health.rows[key], value);
  return { ...row, level, remedy: level ? remedyOf(key, about) : "" };
}

/** Remedy for a reading outside its limit; `about` is the limit or the affected object. */
export function remedyOf(key: string, about: string): string {
  const text = texts().health.remedies[key] ?? "";
  return typeof text === "string" ? text : text(about);
}

export function actuator(name: string): string {
  const { module, wheelNumber } = texts().panel.wheels;
  const [, kind, number = ""] = /^(module|wheel)(\d+)$/.exec(name) ?? [];
  if (kind === undefined) return name.replaceAll("_", " ");
  return kind === "module" ? module(number) : wheelNumber(number);
}

/** Events in the last seconds, of which a few do no harm. */
const count = (key: RowKey, events: number, about?: string) =>
  reading(key, events, 0, "", { most: 10, to: 50, ...(about && { about }) });

function linkRows(link: Link, { status, age_ms }: RobotState): Row[] {
  const [trip, spread] = [roundTripMs(link), jitterMs(link)];
  const limitMs = 1000 * status.limits.max_command_age_s;
  if (trip === null || spread === null || quality(link).grade === "none")
    return [fact("unknownTrip", "–", 2)];
  const level = (trip + spread) / limitMs >= FAIR ? 2 : 1;
  // The limit applies to the sum; the larger part gets the band that the other part leaves.
  const rest = (other: number): Limits => ({ most: GOOD * limitMs - other, to: limitMs, level });
  return [
    reading("trip", trip, 0, "ms", spread > trip ? undefined : rest(spread)),
    reading("jitter", spread, 0, "ms", spread > trip ? rest(trip) : undefined),
    reading("lost", 100 * link.lost, 1, "%", {
      most: 100 * GOOD_LOSS,
      to: 200 * FAIR_LOSS,
      level: link.lost >= FAIR_LOSS ? 2 : 1,
    }),
    reading("pageTrip", link.pageMs, 1, "ms"),
    reading("robotTrip", trip - (link.pageMs ?? 0), 1, "ms"),
    reading("age", age_ms, 0, "ms", { most: STALE_MS, to: 2 * STALE_MS }),
  ];
}

function* estimateRows(
  robot: RobotInfo | null,
  { status, estimate_difference: difference }: RobotState,
  recent: Increases,
): Generator<Row> {
  const { consistency, pose_sensor: poses } = status;
  if (robot?.not_promised.length) {
    yield fact("notTested", "–", 0);
  } else {
    const { level, suspect } = consistency;
    const percent = 100 * (suspect === null ? level : Math.max(1, level));
    const about = actuator(suspect ?? "");
    yield reading("contradiction", percent, 0, "%", { most: 100, to: 200, level: 2, about });
  }
  if (poses) {
    yield reading("poseRate", poses.hz, 0, "Hz", { least: 1, most: Infinity, to: 60 });
    yield reading("poseLatency", poses.latency_s && 1000 * poses.latency_s, 0, "ms");
    yield count("poseDropped", recent.of("poses", sum(poses.dropped)), reasons(poses.dropped));
  }
  if (difference) yield reading("difference", difference.metres, 2, "m");
  for (const [name, bias] of Object.entries(status.learned ?? {}))
    yield biasRow(name, bias.value, bias.sigma);
}

/** End of a name; factor, digits and unit of the page. */
const BIASES: readonly [string, number, number, string][] = [
  ["_rad_per_s", degrees(1)!, 3, "°/s"],
  ["_rad", degrees(1)!, 3, "°"],
  ["_mps", 1000, 2, "mm/s"],
  ["_share", 100, 2, "%"],
  ["_s", 1000, 1, "ms"],
  ["", 1, 3, ""],
];

/** An error that the robot has estimated, with its standard deviation. */
function biasRow(name: string, value: number, sigma: number): Row {
  const [end, factor, digits, unit] = BIASES.find(([last]) => name.endsWith(last))!;
  const base = name.slice(0, name.length - end.length).replaceAll("_", " ");
  const figures = [value, sigma].map((each) => figure(factor * each, digits));
  return plain(`${texts().health.rows.learned} ${base}`, figures.join(" ± "), unit);
}

const sum = (counts: object) => Object.values(counts).reduce((all: number, n) => all + n, 0);

function reasons(counts: object): string {
  const words: Record<string, string> = texts().health.drops;
  const found = Object.entries(counts).filter(([, n]) => n > 0);
  return found.map(([why, n]) => `${words[why] ?? why} ${n}`).join(", ") || "–";
}

function controlRows({ limits }: RobotStatus, robot: RobotInfo | null): Row[] {
  const { rows, notPromised } = texts().health;
  const others = (limits.why ?? []).filter(({ code }) => code !== LOW_BATTERY);
  const why = others.map((reason) => sentence(reason)).join(" ");
  return [
    { ...reading("speedLimit", limits.speed_mps, 2, "m/s"), remedy: why, level: why ? 1 : 0 },
    robot?.not_promised.length
      ? plain(rows.stopDistance, notPromised)
      : reading("stopDistance", limits.stop_allowance_m, 2, "m"),
  ];
}

function* shadowRows({ compared_s, joints, pose, drifts, note }: ShadowReport): Generator<Row> {
  const { rows } = texts().health;
  const compare = (name: string, value: number | null, band: number, unit: string): Row => {
    const decimals = unit === "°" ? 2 : 0;
    const limits = { least: -band, most: band, from: -2 * band, to: 2 * band };
    const about = `±${figure(band, decimals)} ${unit}`;
    return { ...reading("compared", value, decimals, unit, { ...limits, about }), name };
  };
  for (const { part, why } of drifts)
    yield { ...fact("drift", "", 1, sentence(why)), name: part ? actuator(part) : rows.drift };
  for (const { name, unit, measured, simulated, band } of joints)
    yield compare(actuator(name), measured === null ? null : measured - simulated, band, unit);
  for (const [i, name] of pose?.names.entries() ?? [])
    yield compare(`${rows.motion} ${name}`, pose!.difference[i]!, pose!.band[i]!, pose!.units[i]!);
  yield reading("comparedFor", compared_s, 0, "s");
  if (note) yield plain(rows.note, sentence(note));
}

type Facts = Record<string, unknown>;

function hardwareRows(status: RobotStatus, facts: Facts, recent: Increases, path = ""): Row[] {
  return Object.entries(facts).flatMap(([key, value]) => {
    const { quantity, unit = "" } = quantityOf(key);
    const name = `${path}${quantity}`.replaceAll("_", " ");
    if (typeof value === "object" && value !== null && !Array.isArray(value))
      return hardwareRows(status, value as Facts, recent, `${name} `);
    const all = Array.isArray(value) ? value : [value];
    if (key === "battery_v") return batteryRow(status, value);
    if (key === "warnings") return all.map((text) => fact("warning", "", 1, String(text)));
    if (key === "temperature_c" && all.length > 0)
      return reading("temperature", Math.max(...all), 0, "°C", { most: HOT_C, from: 20, to: 90 });
    if (key === "alive" && all.length > 0) {
      const alive = all.filter(Boolean).length;
      return fact("servos", `${alive} / ${all.length}`, alive < all.length ? 2 : 0);
    }
    if (key === "connected") return fact("connected", written(value), value === false ? 2 : 0);
    if (!COUNTED.has(key) || typeof value !== "number") return plain(name, written(value), unit);
    const row = count("serial", recent.of(name, value));
    return { ...row, name: `${row.name} ${name}` };
  });
}

/** Low until the robot takes its limit back, which needs some more voltage than the threshold. */
function batteryRow({ limits }: RobotStatus, value: unknown): Row {
  const low = (limits.why ?? []).find(({ code }) => code === LOW_BATTERY);
  const volts = typeof value === "number" ? value : null;
  if (low === undefined) return reading("battery", volts, 1, "V");
  const least = Number(low.params?.["volts"]);
  const band = { least, most: Infinity, from: 0.8 * least, to: 1.3 * least };
  const { remedy } = fact("battery", "", 1, `${figure(least, 1)} V`);
  return { ...reading("battery", volts, 1, "V", band), level: 1, remedy };
}

function written(value: unknown): string {
  const { yes, no } = texts().health;
  if (Array.isArray(value)) return value.map(written).join(", ");
  if (typeof value === "boolean") return value ? yes : no;
  if (typeof value !== "number") return value === null ? "–" : String(value);
  return value.toLocaleString(language.value, { maximumFractionDigits: 2 }).replace("-", "−");
}
