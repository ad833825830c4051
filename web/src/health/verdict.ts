// The verdict on all readings: never better than the worst of them, and "unknown" without a signal.

import { untracked } from "@preact/signals";
import { freshness, isCurrent, type Freshness } from "../store/freshness";
import type { Link } from "../store/link";
import { sentence } from "../text/reasons";
import { duration } from "../text/numbers";
import { texts } from "../text/text";
import type { Increases } from "./increases";
import { type Groups, type Level, type Row, rowsOf } from "./rows";

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
    const { status } = state;
    const rows = Object.values(groups).flat();
    const outside = rows.filter(({ level }) => level > 0);
    const ofMode = MODE_LEVELS[status.mode] ?? 0;
    const level = Math.max(ofMode, ...rows.map((row) => row.level)) as Level;
    const { modes, findings, advice } = texts().health;
    const names = outside.sort((a, b) => b.level - a.level).map(({ name }) => name);
    const stop = ofMode > 0 && status.stop ? [sentence(status.stop)] : [];
    const what = names.length > 0 ? [advice[level](names.join(", "))] : [];
    const judged = rows.filter(({ band }) => band).length;
    return {
      level,
      title: `${modes[status.mode] ?? ""} ${findings(names.length)}`.trim(),
      advice: [...stop, ...what].join(" ") || advice[0](String(judged)),
      groups,
    };
  });
}

/** Without a signal no figure is known, so none is judged. */
function unknown(fresh: Freshness, groups: Groups): Report {
  const { unknown: words, waiting } = texts().health;
  const isLost = fresh.kind === "offline" || fresh.kind === "silent";
  const blank = (row: Row): Row => {
    const band = row.band && { ...row.band, at: null };
    return { ...row, value: "–", band, level: 0, remedy: "" };
  };
  const blanks = Object.entries(groups).map(([key, rows]) => [key, rows.map(blank)]);
  return {
    level: isLost ? 2 : 1,
    title: isLost ? words[fresh.kind](duration(fresh.forMs / 1000)) : words.starting,
    advice: waiting,
    groups: Object.fromEntries(blanks) as Groups,
  };
}
