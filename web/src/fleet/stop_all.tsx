// STOP ALL, at the place of STOP on the page of all robots. It acts at once: an unnecessary stop does
// less harm than a missing one.

import { useSession } from "../session";
import { texts } from "../text/text";
import { Icon } from "../ui/icon";
import { atOnce } from "./card";
import type { Row } from "./store";
import "./fleet.css";

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
