// Health: the verdict, rows outside their bands with a remedy, all others folded into groups, events.

import { effect, untracked, useComputed } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { useSession } from "../session";
import { sentence } from "../text/reasons";
import { language, texts } from "../text/text";
import { Fold } from "../ui/fold";
import { Icon } from "../ui/icon";
import { Increases } from "./increases";
import type { Band, GroupKey, Row } from "./rows";
import { inspect } from "./verdict";
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
    return untracked(() => inspect(link, recent));
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
  const all = Object.entries(groups) as [GroupKey, Row[]][];
  const outside = all.flatMap(([, rows]) => rows.filter((row) => row.level > 0));
  const within = all.flatMap(([, rows]) => rows.filter((row) => row.band && row.level === 0));
  return (
    <section class="health" aria-label={words.title}>
      <div class={`verdict l${level}`} role="status">
        <Icon name={level === 0 ? "ok" : "warn"} />
        <b>{title}</b>
        <p>{advice}</p>
      </div>
      {outside.length > 0 && (
        <ul aria-label={words.outside}>
          {outside
            .sort((a, b) => b.level - a.level)
            .map((row, i) => (
              <Reading key={i} row={row} />
            ))}
        </ul>
      )}
      <div>
        <h2 class="t">
          {words.within}
          <small>{words.readings(within.length)}</small>
        </h2>
        {all.map(([key, rows]) => (
          <Group key={key} name={key} rows={rows.filter((row) => row.level === 0)} />
        ))}
        {robot !== null && robot.not_promised.length > 0 && (
          <Fold title={words.promises} summary={String(robot.not_promised.length)} open>
            <ul class="promises">
              {robot.not_promised.map((text) => (
                <li key={text}>{text}</li>
              ))}
            </ul>
          </Fold>
        )}
      </div>
      {link.recording === null && <Feed />}
    </section>
  );
}

function Group({ name, rows }: { name: GroupKey; rows: readonly Row[] }) {
  const words = texts().health;
  const fine = rows.filter(({ band }) => band).length;
  if (rows.length === 0) return null;
  const summary = fine > 0 ? words.fine(fine) : words.readings(rows.length);
  return (
    <Fold title={words.groups[name]} summary={summary}>
      <ul>
        {rows.map((row, i) => (
          <Reading key={i} row={row} />
        ))}
      </ul>
    </Fold>
  );
}

function Reading({ row: { name, value, unit, band, level, remedy } }: { row: Row }) {
  return (
    <li class={`reading l${level}`}>
      {level > 0 || band ? <Icon name={level > 0 ? "warn" : "ok"} /> : <span />}
      <span>
        <bdi>{name}</bdi>
      </span>
      <span class="v">
        <bdi>{value}</bdi>
        {unit && <span class="u">{unit}</span>}
      </span>
      {band && <Scale band={band} />}
      {remedy && <p>{remedy}</p>}
    </li>
  );
}

/** The band with its limits, and a mark at the reading. */
function Scale({ band: { least, most, from, to, at } }: { band: Band }) {
  const share = (value: number) => Math.max(0, Math.min(1, (value - from) / (to - from)));
  const percent = (part: number) => `${(100 * part).toFixed(1)}%`;
  return (
    <div class="band" aria-hidden="true">
      <i />
      <em style={{ left: percent(share(least)), right: percent(1 - share(most)) }} />
      {at !== null && <u style={{ left: percent(share(at)) }} />}
    </div>
  );
}

function Feed() {
  const { link } = useSession();
  const words = texts().health;
  const time = (ms: number) =>
    new Date(ms).toLocaleTimeString(language.value, { timeStyle: "medium" });
  const events = link.history.value.slice(-LINES).reverse();
  return (
    <div>
      <h2 class="t">{words.events}</h2>
      <div class="feed" role="log" aria-label={words.events} tabIndex={0}>
        <ul>
          {events.map(({ why, atMs }) => (
            <li key={`${atMs} ${why.code}`}>
              <time dateTime={new Date(atMs).toISOString()} title={new Date(atMs).toISOString()}>
                {time(atMs)}
              </time>
              <span>{sentence(why)}</span>
            </li>
          ))}
          {events.length === 0 && <li class="note">{words.noEvents}</li>}
        </ul>
      </div>
    </div>
  );
}
