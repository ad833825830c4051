// Page of all robots: cards sorted by urgency, a floor map, and the last events.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { useSession } from "../session";
import { texts } from "../text/text";
import { FeedLine } from "../ui/moment";
import { Icon, MODE_ICONS } from "../ui/icon";
import { Card, happened } from "./card";
import { Floor } from "./floor";
import { arranged } from "./store";
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
