// Page of all robots: cards sorted by urgency, a floor map, the last events, and STOP ALL.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import type { Fleet as FleetMessage } from "../generated/wire";
import { useSession } from "../session";
import { degrees, texts } from "../text/text";
import { FeedLine } from "../timeline/clock";
import { Icon, MODE_ICONS } from "../ui/icon";
import { Card, atOnce, happened } from "./card";
import { type Row, arranged } from "./store";
import "./fleet.css";

const COUNTED = ["fault", "stopped", "driving"] as const;

export function Fleet() {
  const search = useSignal("");
  const { fleet } = texts();
  return (
    <main class="view fleet-view" aria-label={fleet.region}>
      <div class="fleet-head">
        <Counts />
        <span class="spacer" />
        <label class="field">
          <Icon name="search" />
          <input
            type="search"
            placeholder={fleet.search}
            aria-label={fleet.search}
            onInput={(event) => (search.value = event.currentTarget.value)}
          />
        </label>
      </div>
      <Cards search={search.value} />
      <aside class="fleet-side" aria-label={fleet.floor}>
        <Floor />
        <Events />
      </aside>
    </main>
  );
}

function Counts() {
  const { fleet } = texts();
  const rows = useSession().fleet.rows.value;
  return (
    <p class="counts">
      <b>{fleet.robots(rows.length)}</b>
      {COUNTED.map((mode) => {
        const count = rows.filter((row) => row.mode === mode && !row.silent).length;
        return (
          count > 0 && (
            <span key={mode} class={mode}>
              <Icon name={MODE_ICONS[mode]!} /> {fleet.counts[mode](count)}
            </span>
          )
        );
      })}
    </p>
  );
}

function Cards({ search }: { search: string }) {
  const { rows, known } = useSession().fleet;
  const { fleet } = texts();
  const list = useRef<HTMLUListElement>(null);
  const shown = useRef({ order: [] as string[], key: "" });
  const byId = new Map(rows.value.map((row) => [row.id, row]));
  const key = [search, ...byId.keys()].join();
  // A card must not move away under a pointer that is about to press its STOP.
  const isInUse = list.current?.matches(":hover, :focus-within") ?? false;
  if (!isInUse || key !== shown.current.key)
    shown.current = { order: arranged(rows.value, search), key };
  const { order } = shown.current;
  if (!known.value) return <p class="cards-none">{fleet.waiting}</p>;
  if (order.length === 0)
    return <p class="cards-none">{byId.size === 0 ? fleet.none : fleet.noMatch}</p>;
  return (
    <ul class="cards" ref={list}>
      {order.map((id) => (
        <Card key={id} row={byId.get(id)!} />
      ))}
    </ul>
  );
}

function Events() {
  const events = useSession().fleet.events.value;
  const { fleet } = texts();
  return (
    <section class="sec">
      <h2>{fleet.events}</h2>
      {events.length === 0 && <p class="note">{fleet.noEvents}</p>}
      <ol class="feed">
        {events.map((row) => (
          <FeedLine key={`${row.id} ${row.event!.atMs}`} atMs={row.event!.atMs}>
            <b>
              <bdi title={row.title}>{row.id}</bdi>
            </b>{" "}
            {happened(row)}
          </FeedLine>
        ))}
      </ol>
    </section>
  );
}

const SIZE = 288; // The map is at least this many pixels wide, so texts are never below 12 px.
const MARGIN = 30;
const LEAST_EXTENT_M = 3;

type Pose = FleetMessage["poses"][string];

/** Scale and place that show all poses; right and down in pixels. */
export function fitted(poses: readonly Pose[]) {
  const [xs, ys] = [poses.map(([x]) => x), poses.map(([, y]) => y)];
  const range = (values: number[]) => [Math.min(...values), Math.max(...values)] as const;
  const [[bottom, top], [right, left]] = [range(xs), range(ys)];
  const scale = (SIZE - 2 * MARGIN) / Math.max(top - bottom, left - right, LEAST_EXTENT_M);
  const place = ([x, y]: Pose) => ({
    right: SIZE / 2 + ((left + right) / 2 - y) * scale,
    down: SIZE / 2 + ((top + bottom) / 2 - x) * scale,
  });
  return { scale, place };
}

/** Floor map of all robots in one frame: x up, y to the left. Robots that are silent are pale. */
function Floor() {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const poses = store.poses.value;
  const placed = store.rows.value.flatMap((row) => {
    const pose = poses[row.id];
    return pose && row.space === "floor" ? [{ row, pose }] : [];
  });
  if (placed.length === 0) return <p class="note">{fleet.noFloor}</p>;
  const { scale, place } = fitted(placed.map(({ pose }) => pose));
  const { right: x, down: y } = place([0, 0, 0]);
  const square = { x, y, width: scale, height: scale };
  return (
    <section class="sec">
      <h2>{fleet.floor}</h2>
      <svg class="floor" viewBox={`0 0 ${SIZE} ${SIZE}`} role="img" aria-label={fleet.floor}>
        <pattern id="floor-grid" patternUnits="userSpaceOnUse" {...square}>
          <path class="grid" d={`M0 ${scale}V0H${scale}`} />
        </pattern>
        <rect width={SIZE} height={SIZE} fill="url(#floor-grid)" />
        {placed.map(({ row, pose }) => {
          const { right, down } = place(pose);
          return (
            <g
              key={row.id}
              class={row.silent ? "robot pale" : "robot"}
              style={{ "--c": row.colour }}
              transform={`translate(${right} ${down})`}
            >
              {row.latched && !row.silent && <circle class="halo" r="14" />}
              <circle class="body" r="9" />
              <path class="nose" d="M0-16l5 7h-10z" transform={`rotate(${degrees(-pose[2])})`} />
              <text y="26">{row.id}</text>
            </g>
          );
        })}
        <path class="scale" d={`M12 ${SIZE - 12}h${scale}`} />
        <text x={12} y={SIZE - 18}>
          {fleet.metre("1")}
        </text>
      </svg>
      {placed.some(({ row }) => row.silent) && <p class="note">{fleet.pale}</p>}
    </section>
  );
}

/**
 * STOP ALL, at the place of STOP. It acts at once: an unnecessary stop does less harm than a missing
 * one.
 */
export function StopAll() {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  return (
    <>
      <p class="all-left note">
        {fleet.own} {fleet.needsNothing}
      </p>
      <div class="stopcell mid">
        <button
          type="button"
          class="stop all"
          aria-label={fleet.stopAllName}
          {...atOnce(() => store.stopAll())}
        >
          <Icon name="stopsign" />
          {fleet.stopAll}
        </button>
        <span class="hint">
          <kbd>Space</kbd> {fleet.stopHint}
        </span>
      </div>
      <Progress />
    </>
  );
}

function Progress() {
  const { rows, outcomes, stoppedAll } = useSession().fleet;
  const { fleet } = texts();
  const robots = rows.value.filter(({ source }) => source !== "recording");
  const names = (of: Row[]) => of.map(({ id }) => id).join(", ");
  const deaf = robots.filter(({ silent }) => silent);
  if (!stoppedAll.value)
    return (
      <p class="all-right note">
        {fleet.allAtOnce(robots.length)} {deaf.length > 0 && fleet.deaf(names(deaf))}
      </p>
    );
  const outcome = ({ id, latched }: Row) => (latched ? "acknowledged" : outcomes.value[id]);
  const done = robots.filter((row) => outcome(row) === "acknowledged");
  const missed = robots.filter((row) => /not_reached|offline/.test(outcome(row) ?? ""));
  return (
    <div class="all-right">
      <p role="status">{fleet.progress(done.length, robots.length)}</p>
      {missed.length > 0 && (
        <p role="alert" class="missed">
          {fleet.missed(names(missed))}
        </p>
      )}
    </div>
  );
}
