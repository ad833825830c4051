// Fields available for plotting: every number in a state, and those sent on request. A field name
// is its path in the message, with wheel and axis names in place of indices.

import type { RobotInfo } from "../generated/wire";

export interface PlotField {
  name: string;
  /** Path to its value in a state. */
  keys: readonly string[];
  unit: string;
  decimals: number;
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
const NOT_PLOTTED = new Set(["status_seq", "robot_s", "plot"]);
const ACTUATORS = new Set(["modules", "wheels", "joints", "setpoint"]);

interface Element {
  name: string;
  unit?: string | undefined;
}

const named = (names: Iterable<string>, unit?: string): Element[] =>
  Array.from(names, (name) => ({ name, unit }));
const POSE = [...named("xy", "m"), { name: "heading", unit: "rad" }];

/** Elements of an array in a state; without any, they are numbered. */
function elementsOf(robot: RobotInfo, array: string): readonly Element[] {
  if (array === "twist" || array === "commanded") return robot.twist_axes;
  if (array === "modules" || array === "wheels") return named(robot[array]);
  if (array === "pose" || array === "truth") return POSE;
  if (array === "ideal" || array === "dual") return named("xyz", "rad/s");
  return named(array === "wxyz" ? array : array.includes("axle") ? "xyz" : "");
}

/** Return the fields of a robot by name: those in its latest state, and those on request. */
export function fieldsOf(robot: RobotInfo, state: object): Map<string, PlotField> {
  const fields: PlotField[] = [];
  const visit = (value: unknown, path: string[], keys: string[], unit?: string) => {
    if (typeof value === "number") fields.push(fieldOf(path, keys, unit));
    if (typeof value !== "object" || value === null) return;
    const elements = Array.isArray(value) ? elementsOf(robot, path.at(-1) ?? "") : null;
    for (const [key, inner] of Object.entries(value)) {
      if (keys.length === 0 && NOT_PLOTTED.has(key)) continue;
      const element = elements?.[Number(key)];
      const name = elements ? (element?.name ?? String(Number(key) + 1)) : key;
      visit(inner, [...path, name], [...keys, key], element?.unit);
    }
  };
  visit(state, [], []);
  for (const name of robot.plot_fields) fields.push(fieldOf(name.split("."), ["plot", name]));
  return new Map(fields.map((field) => [field.name, field]));
}

/** Return the value of a field, or NaN if the state lacks it. */
export function valueOf(field: PlotField | undefined, state: object): number {
  let value: unknown = field && state;
  for (const key of field?.keys ?? []) value = (value as Record<string, unknown> | null)?.[key];
  return typeof value === "number" ? value : NaN;
}

function fieldOf(path: string[], keys: string[], ofElement = ""): PlotField {
  const [parent, last] = [path.at(-2) ?? "", path.at(-1) ?? ""];
  const base = last.replace(/_setpoint$/, ""); // Set-points share the plot of the measured value.
  const { quantity, unit: own } = quantityOf(base);
  const unit = own ?? quantityOf(parent).unit ?? UNITS[base] ?? ofElement;
  const length = path.indexOf("setpoint") > 0 ? 4 : 3;
  const isActuator = path.length === length && ACTUATORS.has(path[0]!);
  const has = (...names: string[]) => names.some((name) => path.includes(name));
  const title = () => {
    if (has("twist", "commanded", "requested")) return unit === "m/s" ? "Velocity" : "Turn rate";
    if (has("sigma")) return "Uncertainty";
    if (has("pose", "truth")) return unit === "m" ? "Position" : "Heading";
    const words = (isActuator ? quantity : `${parent} ${quantity}`).trim().replaceAll("_", " ");
    return words.charAt(0).toUpperCase() + words.slice(1);
  };
  const isSet = has("commanded", "setpoint") || last !== base;
  return {
    name: path.join("."),
    keys,
    unit,
    decimals: DECIMALS[unit] ?? 2,
    title: title(),
    part: isActuator ? path[1]! : quantity.replaceAll("_", " "),
    line: isSet ? "set" : has("requested", "truth", "alternative") ? "other" : "measured",
  };
}

/** Split a key into quantity and unit, such as "battery" and "V" for "battery_v". */
export function quantityOf(key: string): { quantity: string; unit: string | undefined } {
  const isSuffix = (suffix: string) => key === suffix || key.endsWith(`_${suffix}`);
  const suffix = Object.keys(SUFFIXES).find(isSuffix);
  if (suffix === undefined) return { quantity: key, unit: undefined };
  return { quantity: key.slice(0, -suffix.length - 1) || key, unit: SUFFIXES[suffix] };
}
