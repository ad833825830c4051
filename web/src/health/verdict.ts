// The verdict on all readings: never better than the worst of them, and "unknown" without a signal.

import { untracked } from "@preact/signals";
import { freshness, isCurrent, type Freshness } from "../store/freshness";
import type { Link } from "../store/link";
import { sentence } from "../text/reasons";
import { duration, texts } from "../text/text";
import { type Groups, type Increases, type Level, type Row, rowsOf } from "./rows";

export interface Report {
  level: Level;
  title: string;
  advice: string;
  groups: Groups;
}

const MODE_LEVELS: Record<string, Level> = { stopped: 1, fault: 2 };

/** Judge the robot in view now. */
export function inspect(link: Link, recent: Increases): Report {
  return untracked(() => {
    const fresh = freshness(link);
    const state = link.state.peek();
    const groups = state ? rowsOf(link, state, fresh.kind === "live", recent) : {};
    if (state === null || !isCurrent(fresh)) return unknown(fresh, groups);
    const { mode, stop } = state.status;
    const { modes, findings, advice } = texts().health;
    const rows = Object.values(groups).flat();
    const names = outside(rows).map(({ name }) => name);
    const ofMode = MODE_LEVELS[mode] ?? 0;
    const level = Math.max(ofMode, ...rows.map((row) => row.level)) as Level;
    const said = [
      ofMode > 0 && stop && sentence(stop),
      names.length > 0 && advice[level](names.join(", ")),
    ].filter(Boolean);
    return {
      level,
      title: `${modes[mode] ?? ""} ${findings(names.length)}`.trim(),
      advice: said.join(" ") || advice[0](String(rows.filter(({ band }) => band).length)),
      groups,
    };
  });
}

/** Rows outside their bands, the worst first. */
export function outside(rows: readonly Row[]): Row[] {
  return rows.filter(({ level }) => level > 0).sort((a, b) => b.level - a.level);
}

/** Without a signal no figure is known, so none is judged. */
function unknown(fresh: Freshness, groups: Groups): Report {
  const { unknown: words, waiting } = texts().health;
  const isLost = fresh.kind === "offline" || fresh.kind === "silent";
  for (const row of Object.values(groups).flat())
    Object.assign(row, {
      value: "–",
      level: 0,
      remedy: "",
      band: row.band && { ...row.band, at: null },
    });
  return {
    level: isLost ? 2 : 1,
    title: isLost ? words[fresh.kind](duration(fresh.forMs / 1000)) : words.starting,
    advice: waiting,
    groups,
  };
}
