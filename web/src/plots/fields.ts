// Fields available for plotting: every number in a state, and those sent on request. A field name
// is its path in the message, with wheel and axis names in place of indices.

import type { RobotInfo } from "../generated/wire";

export interface PlotField {
  name: string;
  /** Path to its value in a state. */
  keys: readonly string[];
  unit: string;
  /** Fields with one title and unit share a plot, and fields with one part share a colour. */
  title: string;
  part: string;
  line: "set" | "measured" | "other";
}

const table = (text: string) => Object.fromEntries(text.split(" ").map((each) => each.split("=")));
/** Units by key suffix; longer suffixes first. */
const SUFFIXES: Record<string, string> = table(
  "rad_per_s=rad/s mps=m/s rad=rad deg=° percent=% rpm=rpm mm=mm ms=ms us=µs hz=Hz m=m s=s v=V a=A c=°C",
);
/** Units of keys without a suffix. */
const UNITS: Record<string, string> = table("alpha=° beta=° tilt=° degrees=° metres=m");
const DECIMALS: Record<string, number> = { "m/s": 3, m: 3, rad: 3, "°": 1, rpm: 0, ms: 1, Hz: 1 };
const POSE = ["x", "y", "heading"];
/** Element names of arrays, by key. */
const ELEMENTS: Record<string, ArrayLike<string>> = { pose: POSE, truth: POSE, wxyz: "wxyz" };
const COMPONENTS = "xyz"; // For any other short array.
const NOT_PLOTTED = new Set(["status_seq", "robot_s", "plot"]);
const ACTUATORS = new Set(["modules", "wheels", "joints", "setpoint"]);

/** Return the fields of a robot by name: those in its latest state, and those on request. */
export function fieldsOf(robot: RobotInfo, state: object): Map<string, PlotField> {
  const asked = robot.plot_fields.map((name) => field(robot, name.split("."), ["plot", name]));
  return new Map([...leaves(robot, state, [], []), ...asked].map((each) => [each.name, each]));
}

/** Return the value of a field, or NaN if the state lacks it. */
export function valueOf(of: PlotField | undefined, state: object): number {
  let value: unknown = of && state;
  for (const key of of?.keys ?? []) value = (value as Record<string, unknown> | null)?.[key];
  return typeof value === "number" ? value : NaN;
}

export function decimalsOf({ unit }: PlotField): number {
  return DECIMALS[unit] ?? 2;
}

function* leaves(
  robot: RobotInfo,
  value: unknown,
  path: string[],
  keys: string[],
): Generator<PlotField> {
  if (typeof value === "number") yield field(robot, path, keys);
  if (typeof value !== "object" || value === null) return;
  for (const [key, inner] of Object.entries(value)) {
    if (keys.length === 0 && NOT_PLOTTED.has(key)) continue;
    const name = Array.isArray(value) ? element(robot, path, Number(key), value.length) : key;
    yield* leaves(robot, inner, [...path, name], [...keys, key]);
  }
}

function element(robot: RobotInfo, path: string[], i: number, length: number): string {
  const key = path.at(-1) ?? "";
  const number = String(i + 1);
  if (key === "twist" || key === "commanded") return robot.twist_axes[i]?.name ?? number;
  const isOwn = path.length === 1 && (key === "modules" || key === "wheels");
  const names = isOwn ? robot[key] : ELEMENTS[key];
  if (names !== undefined) return names[i] ?? number;
  const isVector = /axle|ideal|dual/.test(key) && length <= COMPONENTS.length;
  return isVector ? COMPONENTS[i]! : number;
}

function field(robot: RobotInfo, path: string[], keys: string[]): PlotField {
  const [parent, last] = [path.at(-2) ?? "", path.at(-1) ?? ""];
  const base = last.replace(/^set_|_setpoint$/, ""); // Set-points share the plot of the measured value.
  const { quantity, unit: own } = quantityOf(base);
  const unit =
    own ?? SUFFIXES[suffixOf(parent) ?? ""] ?? UNITS[base] ?? unitInArray(robot, parent, last);
  const isActuator = path.length === 3 && ACTUATORS.has(path[0]!);
  const has = (...names: string[]) => names.some((name) => path.includes(name));
  const title = () => {
    if (has("twist", "commanded", "requested")) return unit === "m/s" ? "Velocity" : "Turn rate";
    if (has("sigma")) return "Uncertainty";
    if (has("pose", "truth")) return unit === "m" ? "Position" : "Heading";
    const words = (isActuator ? quantity : `${parent} ${quantity}`).trim().replaceAll("_", " ");
    return words.charAt(0).toUpperCase() + words.slice(1);
  };
  const isSet = has("commanded", "setpoint") || last !== base;
  const isOther = has("requested", "truth", "alternative");
  return {
    name: path.join("."),
    keys,
    unit,
    title: title(),
    part: isActuator ? path[1]! : quantity.replaceAll("_", " "),
    line: isSet ? "set" : isOther ? "other" : "measured",
  };
}

/** Split a key into quantity and unit, such as "battery" and "V" for "battery_v". */
export function quantityOf(key: string): { quantity: string; unit: string | undefined } {
  const suffix = suffixOf(key);
  if (suffix === undefined) return { quantity: key, unit: undefined };
  const quantity = suffix === key ? key : key.slice(0, -suffix.length - 1);
  return { quantity, unit: SUFFIXES[suffix] };
}

function suffixOf(key: string): string | undefined {
  return Object.keys(SUFFIXES).find((suffix) => key === suffix || key.endsWith(`_${suffix}`));
}

function unitInArray(robot: RobotInfo, array: string, name: string): string {
  if (array === "twist" || array === "commanded")
    return robot.twist_axes.find((axis) => axis.name === name)?.unit ?? "";
  if (array === "pose" || array === "truth") return name === "heading" ? "rad" : "m";
  return array === "ideal" || array === "dual" ? "rad/s" : "";
}
