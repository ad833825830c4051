// Fields available for plotting: every number in a state, and those sent on request. A field name
// is its path in the message, with wheel and axis names in place of indices.

/** @type {Record<string, string>} Units by key suffix; longer suffixes first. */
const SUFFIXES = {
  rad_per_s: "rad/s",
  mps: "m/s",
  rad: "rad",
  deg: "°",
  percent: "%",
  rpm: "rpm",
  mm: "mm",
  ms: "ms",
  us: "µs",
  hz: "Hz",
  m: "m",
  s: "s",
  v: "V",
  a: "A",
  c: "°C",
};
/** @type {Record<string, string>} Units of keys without a suffix. */
const UNITS = { alpha: "°", beta: "°", tilt: "°", degrees: "°", metres: "m" };
/** @type {Record<string, number>} */
const DECIMALS = { "m/s": 3, m: 3, rad: 3, "°": 1, rpm: 0, ms: 1, Hz: 1 };
/** @type {Record<string, ArrayLike<string>>} Element names of arrays, by key. */
const ELEMENTS = { pose: ["x", "y", "heading"], truth: ["x", "y", "heading"], wxyz: "wxyz" };
const COMPONENTS = "xyz"; // For any other short array.
const NOT_PLOTTED = new Set(["status_seq", "robot_s", "plot"]);
const ACTUATORS = new Set(["modules", "wheels", "joints", "setpoint"]);

/**
 * Return the fields of a robot by name: those in its latest state, and those on request.
 * @param {RobotInfo} robot @param {object} state
 * @returns {Map<string, PlotField>}
 */
export function fieldsOf(robot, state) {
  const fields = [
    ...leaves(robot, state, [], []),
    ...robot.plot_fields.map((name) => field(robot, name.split("."), ["plot", name])),
  ];
  return new Map(fields.map((each) => [each.name, each]));
}

/**
 * Return the value of a field, or NaN if the state lacks it.
 * @param {PlotField | undefined} field @param {object} state
 */
export function valueOf(field, state) {
  /** @type {any} */
  let value = field && state;
  for (const key of field?.keys ?? []) value = value?.[key];
  return typeof value === "number" ? value : NaN;
}

/** @param {PlotField} of */
export function decimalsOf({ unit }) {
  return DECIMALS[unit] ?? 2;
}

/**
 * @param {RobotInfo} robot @param {unknown} value
 * @param {string[]} path @param {string[]} keys
 * @returns {Generator<PlotField>}
 */
function* leaves(robot, value, path, keys) {
  if (typeof value === "number") yield field(robot, path, keys);
  if (typeof value !== "object" || value === null) return;
  for (const [key, inner] of Object.entries(value)) {
    if (keys.length === 0 && NOT_PLOTTED.has(key)) continue;
    const name = Array.isArray(value) ? element(robot, path, Number(key), value.length) : key;
    yield* leaves(robot, inner, [...path, name], [...keys, key]);
  }
}

/** @param {RobotInfo} robot @param {string[]} path @param {number} i @param {number} length */
function element(robot, path, i, length) {
  const key = path.at(-1) ?? "";
  if (key === "twist" || key === "commanded") return robot.twist_axes[i]?.name ?? String(i + 1);
  const isOwn = path.length === 1 && (key === "modules" || key === "wheels");
  const names = isOwn ? robot[key] : ELEMENTS[key];
  if (names !== undefined) return names[i] ?? String(i + 1);
  const isVector = /axle|ideal|dual/.test(key) && length <= COMPONENTS.length;
  return isVector ? COMPONENTS[i] : String(i + 1);
}

/**
 * @param {RobotInfo} robot @param {string[]} path @param {string[]} keys
 * @returns {PlotField}
 */
function field(robot, path, keys) {
  const [parent, last] = [path.at(-2) ?? "", path[path.length - 1]];
  const base = last.replace(/^set_|_setpoint$/, ""); // Setpoints are plotted with the measured value.
  const { quantity, unit: own } = quantityOf(base);
  const unit =
    own ?? SUFFIXES[suffixOf(parent) ?? ""] ?? UNITS[base] ?? unitInArray(robot, parent, last);
  const isActuator = path.length === 3 && ACTUATORS.has(path[0]);
  const has = (/** @type {string[]} */ ...names) => names.some((name) => path.includes(name));
  return {
    name: path.join("."),
    keys,
    unit,
    title: title(),
    part: isActuator ? path[1] : quantity.replaceAll("_", " "),
    line: line(),
  };

  function title() {
    if (has("twist", "commanded", "requested")) return unit === "m/s" ? "Velocity" : "Turn rate";
    if (has("sigma")) return "Uncertainty";
    if (has("pose", "truth")) return unit === "m" ? "Position" : "Heading";
    const words = (isActuator ? quantity : `${parent} ${quantity}`).trim().replaceAll("_", " ");
    return words.charAt(0).toUpperCase() + words.slice(1);
  }

  function line() {
    if (has("commanded", "setpoint") || last !== base) return "set";
    return has("requested", "truth", "alternative") ? "other" : "measured";
  }
}

/**
 * Split a key into quantity and unit, such as "battery" and "V" for "battery_v".
 * @param {string} key
 * @returns {{ quantity: string, unit: string | undefined }}
 */
export function quantityOf(key) {
  const suffix = suffixOf(key);
  if (suffix === undefined) return { quantity: key, unit: undefined };
  const quantity = suffix === key ? key : key.slice(0, -suffix.length - 1);
  return { quantity, unit: SUFFIXES[suffix] };
}

/** @param {string} key */
function suffixOf(key) {
  return Object.keys(SUFFIXES).find((suffix) => key === suffix || key.endsWith(`_${suffix}`));
}

/** @param {RobotInfo} robot @param {string} array @param {string} name */
function unitInArray(robot, array, name) {
  if (array === "twist" || array === "commanded")
    return robot.twist_axes.find((axis) => axis.name === name)?.unit ?? "";
  if (array === "pose" || array === "truth") return name === "heading" ? "rad" : "m";
  return array === "ideal" || array === "dual" ? "rad/s" : "";
}
