// Card of a robot: its mode, its driver, and its STOP.

import type { Reason } from "../generated/wire";
import { useSession } from "../session";
import { nameOf, sentence } from "../text/reasons";
import { duration, texts } from "../text/text";
import { Button } from "../ui/button";
import { Figure } from "../ui/figure";
import { Icon, MODE_ICONS } from "../ui/icon";
import { Outline, Portrait } from "../ui/portrait";
import type { Row } from "./store";

export function Card({ row }: { row: Row }) {
  const { layout, link } = useSession();
  const { common, fleet } = texts();
  const mode = row.silent ? null : row.mode;
  const look = () => {
    link.choose(row.id);
    location.hash = "";
    layout.screen.value = "robot";
  };
  const state = row.silent ? "pale" : mode === "fault" ? "needs" : "";
  return (
    <li class={`rc ${state}`} style={{ "--c": row.colour }}>
      <div class="top">
        <Portrait robot={row.id}>
          <Outline class="outline" panel={row.panel} wheels={row.wheel_count} />
        </Portrait>
        <h3 title={row.title}>
          <bdi>{row.id}</bdi>
        </h3>
        <span class={`mode ${mode}`}>
          <Icon name={MODE_ICONS[mode ?? ""] ?? "ring"} />
          {mode === null ? fleet.noSignal : (common.modes[mode] ?? mode)}
        </span>
      </div>
      <Facts row={row} />
      <div class="act">
        <Button label={fleet.lookAt(row.id)} onPress={look} children={fleet.look} />
        <StopOf row={row} />
      </div>
    </li>
  );
}

function Facts({ row }: { row: Row }) {
  const { link } = useSession();
  const { fleet } = texts();
  void link.beat.value; // Ages pass.
  const own = link.welcome.value?.operator;
  const named = (operator: string) => (operator === own ? fleet.you : operatorName(row, operator));
  const driver = row.driver === null ? null : named(row.driver);
  const source = { recording: fleet.recording, several: fleet.several, robot: fleet.live };
  const battery = row.silent ? null : row.battery;
  const last = row.event && happened(row);
  const why = row.why && reasonOf(row, row.why);
  return (
    <dl>
      <dt>{fleet.driver}</dt>
      <dd class={driver === null ? "none" : ""}>
        {driver === null ? fleet.nobody : <bdi title={driver}>{driver}</bdi>}
        {row.requested_by !== null && (
          <span class="warn"> {fleet.asks(named(row.requested_by))}</span>
        )}
      </dd>
      <dt>{fleet.link}</dt>
      <dd>{row.silent ? fleet.silent(since(row.seenMs)) : source[row.source]}</dd>
      <dt>{fleet.battery}</dt>
      <dd class={battery?.low ? "warn" : ""}>
        <Figure value={battery?.volts} decimals={1} unit={battery ? "V" : ""} />
        {battery?.low && ` ${fleet.low}`}
      </dd>
      {why && (
        <>
          <dt>{fleet.why}</dt>
          <dd title={why}>{why}</dd>
        </>
      )}
      <dt>{fleet.last}</dt>
      <dd title={last ?? ""}>{row.event ? `${last} ${fleet.ago(since(row.event.atMs))}` : "–"}</dd>
    </dl>
  );
}

function StopOf({ row }: { row: Row }) {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const outcome = store.outcomes.value[row.id] ?? null;
  const isShown = outcome !== null && outcome !== "acknowledged"; // Which its mode shows.
  const lost = row.silent ? fleet.noLink(since(row.seenMs)) : null;
  const refused = row.source === "recording" ? fleet.isRecording : lost;
  const said = isShown ? fleet.outcomes[outcome] : "";
  const missed = store.missed.value[row.id];
  const why = refused ?? (missed && reasonOf(row, missed));
  return (
    <button
      type="button"
      class="btn card-stop"
      aria-label={`${fleet.stopOf(row.id)}. ${why ?? said}`}
      title={why ?? undefined}
      aria-disabled={refused !== null || undefined}
      {...atOnce(() => refused === null && store.stop(row.id))}
    >
      {row.latched && !row.silent ? fleet.stopped : fleet.stop}
      <small role="status">{said}</small>
    </button>
  );
}

/** Handlers of a button that acts when touched; keys and assistive technology click instead. */
export function atOnce(act: () => void) {
  const press = (event: Event) => {
    event.preventDefault();
    act();
  };
  return {
    onPointerDown: (event: PointerEvent) => event.button === 0 && press(event),
    onClick: (event: MouseEvent) => event.detail === 0 && press(event),
  };
}

/** Return the latest event of a robot as a sentence. */
export function happened(row: Row): string {
  return row.event ? reasonOf(row, row.event.why) : "";
}

function reasonOf(row: Row, why: Reason): string {
  return sentence(why, (operator) => operatorName(row, operator));
}

function operatorName({ operators }: Row, operator: string): string {
  return operators[operator] ?? nameOf(operator);
}

function since(ms: number | null): string {
  return ms === null ? "–" : duration((Date.now() - ms) / 1000);
}
