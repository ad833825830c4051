// Card of one robot: what it does, who drives it, and its own STOP.

import { useSession } from "../session";
import { nameOf, sentence } from "../text/reasons";
import { duration, figure } from "../text/numbers";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon, type IconName } from "../ui/icon";
import { Picture } from "./picture";
import type { Row } from "./store";

const MODE_ICONS: Record<string, IconName> = {
  driving: "play",
  stopped: "stopsign",
  fault: "warn",
  ready: "full",
};

/** Return the name of an operator on a robot, or "You" for the one of this page. */
function driverName(row: Row, operator: string, own: string | undefined): string {
  return operator === own ? texts().fleet.you : (row.operators[operator] ?? nameOf(operator));
}

/** Return the latest event of a robot as a sentence, or null. */
function lastEvent({ event, operators }: Row): string | null {
  return event && sentence(event.why, (operator) => operators[operator] ?? nameOf(operator));
}

function since(ms: number | null): string {
  return ms === null ? "–" : duration((Date.now() - ms) / 1000);
}

/** Return why a stop of the robot would not be heard, or null. */
function whyNotStop(row: Row): string | null {
  const { fleet } = texts();
  if (row.source === "recording") return fleet.isRecording;
  return row.silent ? fleet.noLink(since(row.seenMs)) : null;
}

export function Card({ id }: { id: string }) {
  const { fleet: store, layout, link } = useSession();
  const row = store.row(id)?.value;
  if (row === undefined) return null;
  const { fleet } = texts();
  const look = () => {
    link.choose(id);
    location.hash = "";
    layout.screen.value = "robot";
  };
  const classes = ["rc", row.mode === "fault" && !row.silent && "needs", row.silent && "pale"];
  return (
    <li class={classes.filter(Boolean).join(" ")} style={{ "--c": row.colour }}>
      <div class="top">
        <Picture panel={row.panel} wheels={row.wheel_count} />
        <h3 title={row.title}>
          <bdi>{row.id}</bdi>
        </h3>
        <Mode row={row} />
      </div>
      <Facts row={row} />
      <div class="act">
        <Button label={fleet.lookAt(row.id)} onPress={look}>
          {fleet.look}
        </Button>
        <StopOf row={row} />
      </div>
    </li>
  );
}

function Mode({ row }: { row: Row }) {
  const { common, fleet } = texts();
  const mode = row.silent ? "silent" : (row.mode ?? "silent");
  return (
    <span class={`mode ${mode}`}>
      <Icon name={MODE_ICONS[mode] ?? "ring"} />
      {mode === "silent" ? fleet.noSignal : (common.modes[mode] ?? mode)}
    </span>
  );
}

function Facts({ row }: { row: Row }) {
  const { link } = useSession();
  const { fleet } = texts();
  link.beat.value; // Ages pass.
  const own = link.welcome.value?.operator;
  const { driver, requested_by, battery, event } = row;
  const state = { recording: fleet.recording, several: fleet.several, robot: fleet.live };
  return (
    <dl>
      <dt>{fleet.driver}</dt>
      <dd class={driver === null ? "none" : ""}>
        {driver === null ? fleet.nobody : <bdi>{driverName(row, driver, own)}</bdi>}
        {requested_by !== null && (
          <em class="asks"> {fleet.asks(driverName(row, requested_by, own))}</em>
        )}
      </dd>
      <dt>{fleet.link}</dt>
      <dd>{row.silent ? fleet.silent(since(row.seenMs)) : state[row.source]}</dd>
      <dt>{fleet.battery}</dt>
      <dd class={battery?.low && !row.silent ? "warn" : ""}>
        {battery === null || row.silent ? "–" : figure(battery.volts, 1)}
        {battery !== null && !row.silent && <span class="u">V</span>}
        {battery?.low && !row.silent && ` ${fleet.low}`}
      </dd>
      <dt>{fleet.last}</dt>
      <dd title={lastEvent(row) ?? undefined}>
        {event ? `${lastEvent(row)} ${fleet.ago(since(event.atMs))}` : "–"}
      </dd>
    </dl>
  );
}

function StopOf({ row }: { row: Row }) {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const outcome = store.outcome(row.id).value;
  const refused = whyNotStop(row);
  const label = row.latched && !row.silent ? fleet.stopped : fleet.stop;
  const shown =
    outcome && outcome.outcome !== "acknowledged" ? fleet.outcomes[outcome.outcome] : "";
  const press = (event: Event) => {
    event.preventDefault();
    if (refused === null) store.stop(row.id);
  };
  return (
    <button
      type="button"
      class="btn card-stop"
      aria-label={`${fleet.stopOf(row.id)}. ${refused ?? shown}`}
      title={refused ?? undefined}
      aria-disabled={refused !== null || undefined}
      onPointerDown={(event) => event.button === 0 && press(event)}
      onClick={(event) => event.detail === 0 && press(event)}
    >
      {label}
      <small role="status">{shown}</small>
    </button>
  );
}
