// Health: the verdict, rows outside their bands with a remedy, all others folded into groups, events.

import { effect, untracked, useComputed } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { useSession } from "../session";
import { type Freshness, freshness, isCurrent } from "../store/freshness";
import type { Link } from "../store/link";
import { sentence } from "../text/reasons";
import { duration, language, texts } from "../text/text";
import { FeedLine } from "../timeline/clock";
import { Fold } from "../ui/fold";
import { Icon } from "../ui/icon";
import type { Band, GroupKey, Groups, Level, Row } from "./rows";
import { Increases, rowsOf } from "./rows";
import "./health.css";

const BEATS = 3; // Figures change about three times a second, so that they can be read.
const LINES = 40;

export function Health() {
  const { link } = useSession();
  const robot = link.robot.value;
  const recent = useMemo(() => new Increases(), [robot?.id]);
  const turn = useComputed(() => Math.floor(link.beat.value / BEATS));
  const report = useComputed(() => {
    void [turn.value, language.value, link.robot.value, link.connected.value];
    return inspect(link, recent);
  });
  // The server compares only while it is shown.
  useEffect(() => {
    const end = effect(() => void (link.connected.value && link.send({ t: "shadow", on: true })));
    return () => {
      end();
      link.send({ t: "shadow", on: false });
    };
  }, [link]);
  const { level, title, advice, groups } = report.value;
  const words = texts().health;
  const rows = Object.values(groups).flat();
  const worst = outside(rows);
  const fine = (row: Row) => row.band !== null && row.level === 0;
  return (
    <section class="health" aria-label={words.title}>
      <div class={`verdict l${level}`} role="status">
        <Icon name={level === 0 ? "ok" : "warn"} />
        <b>{title}</b>
        <p>{advice}</p>
      </div>
      {worst.length > 0 && <Readings rows={worst} label={words.outside} />}
      <div>
        <h2 class="t">
          {words.within}
          <small>{words.readings(rows.filter(fine).length)}</small>
        </h2>
        {(Object.entries(groups) as [GroupKey, Row[]][]).map(([key, all]) => {
          const within = all.filter((row) => row.level === 0);
          const count = within.filter(fine).length;
          const summary = count > 0 ? words.fine(count) : words.readings(within.length);
          return (
            within.length > 0 && (
              <Fold key={key} title={words.groups[key]} summary={summary}>
                <Readings rows={within} />
              </Fold>
            )
          );
        })}
      </div>
      {link.recording === null && <Feed />}
    </section>
  );
}

function Readings({ rows, label }: { rows: readonly Row[]; label?: string }) {
  return (
    <ul aria-label={label}>
      {rows.map(({ name, value, unit, band, level, remedy }, i) => (
        <li key={i} class={`reading l${level}`}>
          {level > 0 || band ? <Icon name={level > 0 ? "warn" : "ok"} /> : <span />}
          <bdi>{name}</bdi>
          <span class="v">
            <bdi>{value}</bdi>
            {unit && <span class="u">{unit}</span>}
          </span>
          {band && <Scale band={band} />}
          {remedy && <p>{remedy}</p>}
        </li>
      ))}
    </ul>
  );
}

function Scale({ band: { least, most, from, to, at } }: { band: Band }) {
  const percent = (value: number) =>
    `${Math.max(0, Math.min(100, (100 * (value - from)) / (to - from)))}%`;
  return (
    <div class="band" aria-hidden="true">
      <i />
      <em style={{ left: percent(least), right: `calc(100% - ${percent(most)})` }} />
      {at !== null && <u style={{ left: percent(at) }} />}
    </div>
  );
}

function Feed() {
  const { link } = useSession();
  const words = texts().health;
  const events = link.history.value.slice(-LINES).reverse();
  return (
    <div>
      <h2 class="t">{words.events}</h2>
      <div class="feed" role="log" aria-label={words.events} tabIndex={0}>
        <ul>
          {events.map(({ why, atMs }) => (
            <FeedLine key={`${atMs} ${why.code}`} atMs={atMs}>
              {sentence(why)}
            </FeedLine>
          ))}
        </ul>
        {events.length === 0 && <p class="note">{words.noEvents}</p>}
      </div>
    </div>
  );
}

const MODE_LEVELS: Record<string, Level> = { stopped: 1, fault: 2 };

/** Judge the robot in view now: never better than its worst reading. */
export function inspect(link: Link, recent: Increases) {
  return untracked(() => {
    const fresh = freshness(link);
    const state = link.state.peek();
    const groups: Groups = state ? rowsOf(link, state, fresh.kind === "live", recent) : {};
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

function outside(rows: readonly Row[]): Row[] {
  return rows.filter(({ level }) => level > 0).sort((a, b) => b.level - a.level);
}

/** Without a signal no figure is known, so none is judged. */
function unknown(fresh: Freshness, groups: Groups) {
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
    level: (isLost ? 2 : 1) as Level,
    title: isLost ? words[fresh.kind](duration(fresh.forMs / 1000)) : words.starting,
    advice: waiting,
    groups,
  };
}
