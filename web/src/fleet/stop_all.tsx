// STOP ALL, at the place of STOP on the page of all robots. It acts at once: an unnecessary stop does
// less harm than a missing one.

import { useSession } from "../session";
import { texts } from "../text/text";
import { Icon } from "../ui/icon";
import "./fleet.css";

export function StopAll() {
  const { fleet: store } = useSession();
  const { fleet } = texts();
  const press = (event: Event) => {
    event.preventDefault();
    store.stopAll();
  };
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
          onPointerDown={(event) => event.button === 0 && press(event)}
          onClick={(event) => event.detail === 0 && press(event)}
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
  const { fleet: store } = useSession();
  const { fleet } = texts();
  store.changes.value;
  const robots = store.rows().filter(({ source }) => source !== "recording");
  const names = (rows: typeof robots) => rows.map(({ id }) => id).join(", ");
  const deaf = robots.filter(({ silent }) => silent);
  if (!store.stoppedAll.value)
    return (
      <p class="all-right note">
        {fleet.allAtOnce(robots.length)} {deaf.length > 0 && fleet.deaf(names(deaf))}
      </p>
    );
  const outcomes = robots.map((row) => ({ row, to: store.outcome(row.id).value?.outcome }));
  const done = outcomes.filter(({ row, to }) => to === "acknowledged" || row.latched).length;
  const missed = outcomes.filter(
    ({ row, to }) => !row.latched && (to === "not_reached" || to === "offline"),
  );
  return (
    <div class="all-right">
      <p role="status">{fleet.progress(done, robots.length)}</p>
      {missed.length > 0 && (
        <p role="alert" class="missed">
          {fleet.missed(names(missed.map(({ row }) => row)))}
        </p>
      )}
    </div>
  );
}
