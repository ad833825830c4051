// Readings of the robot and the link to it, each judged by its band where it has one.

import { quantityOf } from "../plots/fields";
import type { RobotInfo, RobotState, RobotStatus, ShadowReport } from "../generated/wire";
import { STALE_MS } from "../store/freshness";
import type { Link } from "../store/link";
import { FAIR, FAIR_LOSS, GOOD, GOOD_LOSS, jitterMs, quality, roundTripMs } from "../store/quality";
import { degrees, figure } from "../text/numbers";
import { nameOf, sentence } from "../text/reasons";
import { texts } from "../text/text";
import type { Increases } from "./increases";

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

export type GroupKey = keyof ReturnType<typeof texts>["health"]["groups"];
export type Groups = Partial<Record<GroupKey, Row[]>>;
type RowKey = keyof ReturnType<typeof texts>["health"]["rows"];

interface Limits {
  least?: number;
  most: number;
  from?: number;
  to: number;
  level?: Level;
  about?: string;
}

const LOOP_HZ = 100; // PERIOD_S of node/robot_node.py.
const LOOP_JITTER_MS = 5; // Half a period.
const HOT_C = 70; // HOT_C of control/monitors.py.
const COUNTED = new Set(["missed", "broken", "reconnects"]); // Errors of serial lines.
const LOW_BATTERY = "battery_low"; // Its own row shows it.

/** Return the rows of all groups that this robot has; counters refer to the last seconds. */
export function rowsOf(link: Link, state: RobotState, isLive: boolean, recent: Increases): Groups {
  const { status, shadow } = state;
  const robot = link.robot.peek();
  return {
    ...(isLive ? { link: linkRows(link, state) } : {}),
    loop: loopRows(status, recent),
    estimate: estimateRows(robot, state, recent),
    hardware: hardwareRows(status, status.hardware, recent),
    commands: commandRows(status, recent),
    control: controlRows(state, robot),
    ...(shadow ? { shadow: shadowRows(shadow) } : {}),
  };
}

function reading(
  key: RowKey,
  value: number | null,
  decimals: number,
  unit: string,
  limits?: Limits,
): Row {
  const { rows, remedies } = texts().health;
  const shown = plain(rows[key], figure(value, decimals), unit);
  if (!limits) return shown;
  const { least = -Infinity, most, from = 0, to, level = 1, about } = limits;
  const isOutside = value !== null && (value < least || value >= most);
  const limit = isOutside && value < least ? least : most;
  const text = `${figure(limit, Number.isInteger(limit) ? 0 : decimals)} ${unit}`;
  return {
    ...shown,
    band: { least, most, from, to, at: value },
    level: isOutside ? level : 0,
    remedy: isOutside ? (remedies[key]?.(about ?? text) ?? "") : "",
  };
}

function plain(name: string, value: string, unit = ""): Row {
  return { name, value, unit, band: null, level: 0, remedy: "" };
}

/** A fact without a scale that is wrong or not. */
function fact(key: RowKey, value: string, level: Level, about = ""): Row {
  const row = reading(key, level, 0, "", { most: 1, to: 1, level, about });
  return { ...row, value, band: null };
}

function linkRows(link: Link, { status, age_ms }: RobotState): Row[] {
  const [trip, spread] = [roundTripMs(link), jitterMs(link)];
  const limitMs = 1000 * status.limits.max_command_age_s;
  if (trip === null || spread === null || quality(link).grade === "none")
    return [fact("unknownTrip", "–", 2)];
  const level = (trip + spread) / limitMs >= FAIR ? 2 : 1;
  // The limit applies to the sum; the larger part gets the band that the other part leaves.
  const rest = (other: number) => ({ most: GOOD * limitMs - other, to: limitMs, level }) as const;
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

function loopRows({ loop }: RobotStatus, recent: Increases): Row[] {
  const rate = { least: 0.95 * LOOP_HZ, most: 1.05 * LOOP_HZ, from: 0.5 * LOOP_HZ };
  return [
    reading("rate", loop.hz, 1, "Hz", { ...rate, to: 1.5 * LOOP_HZ }),
    reading("loopJitter", loop.jitter_p99_ms, 1, "ms", { most: LOOP_JITTER_MS, to: 20 }),
    reading("overruns", recent.of("overruns", loop.overruns), 0, "", { most: 10, to: 50 }),
  ];
}

function estimateRows(robot: RobotInfo | null, state: RobotState, recent: Increases): Row[] {
  const { consistency, pose_sensor: poses, learned } = state.status;
  const { level, suspect, residual_mps } = consistency;
  const limits = {
    most: 100,
    to: 200,
    level: 2,
    about: texts().health.actuator(suspect ?? ""),
  } as const;
  const share = suspect === null ? level : Math.max(1, level);
  const tested = [
    reading("contradiction", 100 * share, 0, "%", limits),
    reading("residual", 1000 * residual_mps, 1, "mm/s"),
  ];
  const sum = (counts: object) => Object.values(counts).reduce((all: number, n) => all + n, 0);
  const difference = state.estimate_difference;
  return [
    ...(robot?.not_promised.length ? [fact("notTested", "–", 0)] : tested),
    ...(poses
      ? [
          reading("poseRate", poses.hz, 0, "Hz", { least: 1, most: Infinity, to: 60 }),
          reading("poseLatency", poses.latency_s && 1000 * poses.latency_s, 0, "ms"),
          reading("poseDropped", recent.of("poses", sum(poses.dropped)), 0, "", {
            most: 10,
            to: 50,
            about: dropped(poses.dropped),
          }),
        ]
      : []),
    ...(difference ? [reading("difference", difference.metres, 2, "m")] : []),
    ...Object.entries(learned ?? {}).map(([name, bias]) => biasRow(name, bias.value, bias.sigma)),
  ];
}

/** End of a name; factor, digits and unit of the page. */
const BIASES: readonly [string, number, number, string][] = [
  ["_rad_per_s", degrees(1)!, 3, "°/s"],
  ["_rad", degrees(1)!, 3, "°"],
  ["_mps", 1000, 2, "mm/s"],
  ["_share", 100, 2, "%"],
  ["_s", 1000, 1, "ms"],
];

function biasRow(name: string, value: number, sigma: number): Row {
  const [end, factor, digits, unit] = BIASES.find(([last]) => name.endsWith(last)) ?? [
    "",
    1,
    3,
    "",
  ];
  const base = name.slice(0, name.length - end.length).replaceAll("_", " ");
  const figures = [value, sigma].map((each) => figure(factor * each, digits));
  return plain(`${texts().health.rows.learned} ${base}`, figures.join(" ± "), unit);
}

function dropped(counts: object): string {
  const words: Record<string, string> = texts().health.drops;
  const found = Object.entries(counts).filter(([, count]) => count > 0);
  return found.map(([why, count]) => `${words[why] ?? why} ${count}`).join(", ") || "–";
}

function commandRows({ command, limits }: RobotStatus, recent: Increases): Row[] {
  const { dropped: counts, accepted } = command;
  const all = Object.values(counts).reduce((sum, count) => sum + count, 0);
  const about = dropped(counts);
  return [
    reading("accepted", accepted, 0, ""),
    reading("dropped", recent.of("dropped", all), 0, "", { most: 10, to: 50, about }),
    plain(texts().health.rows.droppedAll, about),
    reading("ageLimit", 1000 * limits.max_command_age_s, 0, "ms"),
  ];
}

function controlRows({ status }: RobotState, robot: RobotInfo | null): Row[] {
  const { lease, limits } = status;
  const { rows, nobody, notPromised } = texts().health;
  const name = (operator: string | null) => (operator === null ? nobody : nameOf(operator));
  const reasons = (limits.why ?? []).filter(({ code }) => code !== LOW_BATTERY);
  const why = reasons.map((reason) => sentence(reason)).join(" ");
  return [
    plain(rows.holder, name(lease.holder)),
    ...(lease.requested_by === null ? [] : [plain(rows.askedBy, name(lease.requested_by))]),
    ...(lease.reserved_for === null ? [] : [plain(rows.reservedFor, name(lease.reserved_for))]),
    { ...reading("speedLimit", limits.speed_mps, 2, "m/s"), remedy: why, level: why ? 1 : 0 },
    robot?.not_promised.length
      ? plain(rows.stopDistance, notPromised)
      : reading("stopDistance", limits.stop_allowance_m, 2, "m"),
  ];
}

function shadowRows({ joints, pose, drifts, note }: ShadowReport): Row[] {
  const { rows, actuator } = texts().health;
  const compare = (name: string, value: number | null, band: number, unit: string): Row => {
    const decimals = unit === "°" ? 2 : 0;
    const limits = { least: -band, most: band, from: -2 * band, to: 2 * band };
    const about = `±${figure(band, decimals)} ${unit}`;
    return { ...reading("compared", value, decimals, unit, { ...limits, about }), name };
  };
  const [names, units, off] = [pose?.names ?? [], pose?.units ?? [], pose?.difference ?? []];
  return [
    ...drifts.map(({ part, text }) => ({ ...fact("drift", "", 1, text), name: actuator(part) })),
    ...joints.map(({ name, unit, measured, simulated, band }) =>
      compare(actuator(name), measured === null ? null : measured - simulated, band, unit),
    ),
    ...names.map((name, i) =>
      compare(`${rows.motion} ${name}`, off[i]!, pose!.band[i]!, units[i]!),
    ),
    ...(note ? [plain(rows.note, note)] : []),
  ];
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
      const count = all.filter(Boolean).length;
      return fact("servos", `${count} / ${all.length}`, count < all.length ? 2 : 0);
    }
    if (key === "connected") return fact("connected", written(value), value === false ? 2 : 0);
    if (!COUNTED.has(key) || typeof value !== "number") return plain(name, written(value), unit);
    const row = reading("serial", recent.of(name, value), 0, "", { most: 10, to: 50 });
    return { ...row, name: `${row.name} ${name}` };
  });
}

/** Low until the robot takes its limit back, which needs some more voltage than the threshold. */
function batteryRow({ limits }: RobotStatus, volts: unknown): Row {
  const low = (limits.why ?? []).find(({ code }) => code === LOW_BATTERY);
  const known = typeof volts === "number" ? volts : null;
  if (low === undefined) return reading("battery", known, 1, "V");
  const least = Number(low.params?.["volts"]);
  const band = { least, most: Infinity, from: 0.8 * least, to: 1.3 * least };
  const remedy = texts().health.remedies["battery"]!(`${figure(least, 1)} V`);
  return { ...reading("battery", known, 1, "V", band), level: 1, remedy };
}

function written(value: unknown): string {
  const { yes, no } = texts().health;
  if (Array.isArray(value)) return value.map(written).join(", ");
  if (typeof value === "boolean") return value ? yes : no;
  if (typeof value !== "number") return value === null ? "–" : String(value);
  const digits = [0, 1].find((count) => Math.abs(value - Number(value.toFixed(count))) < 0.005);
  return figure(value, digits ?? 2);
}
