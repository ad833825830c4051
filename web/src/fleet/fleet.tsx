// Page of all robots: cards sorted by what needs somebody, one floor map, and the last events.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { useSession } from "../session";
import { isOneOf, remembered } from "../store/memory";
import { nameOf, sentence } from "../text/reasons";
import { texts } from "../text/text";
import { Icon } from "../ui/icon";
import { Menu } from "../ui/menu";
import { Card } from "./card";
import { Floor } from "./floor";
import { arranged, type Sorting, SORTINGS } from "./store";
import "./fleet.css";

const sorting = remembered<Sorting>("tsd-fleet-sort", "need", isOneOf(SORTINGS));

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
            value={search.value}
            onInput={(event) => (search.value = event.currentTarget.value)}
          />
        </label>
        <Menu
          label={`${fleet.sort}: ${fleet.sortings[sorting.value]}`}
          button={
            <>
              {fleet.sortings[sorting.value]} <Icon name="down" />
            </>
          }
          items={SORTINGS.map((each) => ({
            text: fleet.sortings[each],
            checked: each === sorting.value,
            onChoose: () => (sorting.value = each),
          }))}
        />
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
  const { fleet: store } = useSession();
  const { fleet } = texts();
  store.changes.value;
  const rows = store.rows();
  const count = (mode: string) => rows.filter((row) => row.mode === mode && !row.silent).length;
  const [faults, stopped, driving] = [count("fault"), count("stopped"), count("driving")];
  return (
    <p class="counts">
      <b>{fleet.robots(rows.length)}</b>
      {faults > 0 && (
        <span class="danger">
          <Icon name="warn" /> {fleet.counts.fault(faults)}
        </span>
      )}
      {stopped > 0 && (
        <span>
          <Icon name="stopsign" /> {fleet.counts.stopped(stopped)}
        </span>
      )}
      {driving > 0 && (
        <span>
          <Icon name="play" /> {fleet.counts.driving(driving)}
        </span>
      )}
    </p>
  );
}

function Cards({ search }: { search: string }) {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const list = useRef<HTMLUListElement>(null);
  const before = useRef<{ order: string[]; key: string }>({ order: [], key: "" });
  store.changes.value;
  const key = `${sorting.value} ${search} ${store.ids.value.join()}`;
  // A card must not move away under a pointer that is about to press its STOP.
  const isInUse = list.current?.matches(":hover, :focus-within") ?? false;
  if (!isInUse || key !== before.current.key)
    before.current = { order: arranged(store.rows(), sorting.value, search), key };
  const { order } = before.current;
  if (!store.known.value) return <p class="cards-none">{fleet.waiting}</p>;
  if (order.length === 0)
    return <p class="cards-none">{store.ids.value.length === 0 ? fleet.none : fleet.noMatch}</p>;
  return (
    <ul class="cards" ref={list}>
      {order.map((id) => (
        <Card key={id} id={id} />
      ))}
    </ul>
  );
}

function Events() {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const events = store.events.value;
  return (
    <section class="sec">
      <h2>{fleet.events}</h2>
      {events.length === 0 && <p class="note">{fleet.noEvents}</p>}
      <ol class="feed">
        {events.map(({ robot, title, why, atMs, operators }) => (
          <li key={`${robot} ${atMs}`}>
            <time dateTime={new Date(atMs).toISOString()} title={new Date(atMs).toISOString()}>
              {new Date(atMs).toLocaleTimeString()}
            </time>
            <span>
              <b>
                <bdi title={title}>{robot}</bdi>
              </b>{" "}
              {sentence(why, (operator) => operators[operator] ?? nameOf(operator))}
            </span>
          </li>
        ))}
      </ol>
    </section>
  );
}
