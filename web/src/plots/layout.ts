// Which fields are plotted in which pane, and over which time; as text for storage and links.

import type { RobotInfo } from "../generated/wire";
import type { PlotField } from "./fields";

export const MAX_FIELDS = 16;
const MAX_UNITS = 2; // An axis on the left and one on the right.
const USUAL_WINDOW_S = 20;
const [MIN_WINDOW_S, MAX_WINDOW_S] = [1, 600];

export type Panes = readonly (readonly string[])[];
type Fields = ReadonlyMap<string, PlotField>;

export interface PlotLayout {
  windowS: number;
  /** Names of fields; the robot may not have all of them. */
  panes: Panes;
}

export function usualLayout({ panel, twist_axes, modules, wheels }: RobotInfo): PlotLayout {
  const twists = [...Map.groupBy(twist_axes, ({ unit }) => unit).values()].map((axes) =>
    ["commanded", "twist"].flatMap((twist) => axes.map(({ name }) => `${twist}.${name}`)),
  );
  const speeds = wheels.flatMap((name) => [`wheels.${name}.rpm_setpoint`, `wheels.${name}.rpm`]);
  const tilts = modules.map((name) => `modules.${name}.tilt`);
  const residual = panel === "sphere" ? "sphere.angle_deg" : "status.consistency.residual_mps";
  const errors = panel === "twist" ? [] : [residual];
  const panes = [...twists, tilts, speeds, errors, ["link.round_trip_ms"]];
  return { windowS: USUAL_WINDOW_S, panes: limited(panes) };
}

function limitedWindow(seconds: number): number {
  return Math.max(MIN_WINDOW_S, Math.min(MAX_WINDOW_S, seconds));
}

/** Drop repeated fields, those above the limit, and empty panes. */
function limited(panes: Panes): Panes {
  const seen = new Set<string>();
  const take = (name: string) => !seen.has(name) && seen.size < MAX_FIELDS && seen.add(name);
  return panes.map((pane) => pane.filter(take)).filter((pane) => pane.length > 0);
}

/** Put a field into the pane `to`, after the last one into a new pane; null removes it. */
export function moved(panes: Panes, name: string, to: number | null): Panes {
  const others = [...panes, []].map((pane) => pane.filter((each) => each !== name));
  return limited(others.map((pane, i) => (i === to ? [...pane, name] : pane)));
}

/** Whether one of the two axes of a pane suits a field. */
export function fits(pane: readonly string[], field: PlotField, known: Fields): boolean {
  const units = new Set([field.unit, ...pane.flatMap((name) => known.get(name)?.unit ?? [])]);
  return units.size <= MAX_UNITS;
}

/** Return the pane with fields like this one, or else a new one. */
export function homeOf(panes: Panes, { title, unit }: PlotField, known: Fields): number {
  const isAlike = (field?: PlotField) => field?.title === title && field.unit === unit;
  const at = panes.findIndex((pane) => pane.some((name) => isAlike(known.get(name))));
  return at < 0 ? panes.length : at;
}

/** Return a layout as text: `20:twist.vx,twist.vy;link.round_trip_ms`. */
export function encode({ windowS, panes }: PlotLayout): string {
  const pane = (names: readonly string[]) => names.map(encodeURIComponent).join(",");
  return `${Math.round(10 * limitedWindow(windowS)) / 10}:${panes.map(pane).join(";")}`;
}

/** Return the layout in a text from a link or an older page, or null. */
export function decode(text: unknown): PlotLayout | null {
  const [, seconds, panes] = /^([\d.]+):(.*)$/.exec(typeof text === "string" ? text : "") ?? [];
  const windowS = Number(seconds);
  if (panes === undefined || limitedWindow(windowS) !== windowS) return null;
  try {
    const names = panes.split(";").map((pane) => pane.split(",").filter(Boolean));
    return { windowS, panes: limited(names.map((pane) => pane.map(decodeURIComponent))) };
  } catch {
    return null; // A damaged link.
  }
}
