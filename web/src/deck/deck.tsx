// Deck: five places at the bottom that never move. Stick, next step or speed, STOP, heading, turning.

import { useComputed } from "@preact/signals";
import { StopAll } from "../fleet/stop_all";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { texts } from "../text/text";
import { SprungSlider, useSprungSlider } from "../ui/sprung_slider";
import { Heading } from "./heading";
import { Slot } from "./slot";
import { Stick, spokenOf } from "./stick";
import { whyOff } from "./steps";
import { StopCell } from "./stop_cell";
import "./deck.css";

export function Deck() {
  const session = useSession();
  const { deck } = texts();
  const { link, layout } = session;
  const kind = useComputed(() => link.beat.value >= 0 && freshness(link).kind).value;
  const off = useComputed(() => whyOff(session) !== null).value;
  if (layout.screen.value === "fleet")
    return (
      <section class="deck all" aria-label={deck.region}>
        <StopAll />
      </section>
    );
  const hasRobot = kind !== "starting" && kind !== "no_robot";
  const drives = hasRobot && kind !== "recorded";
  return (
    <section class={off ? "deck off" : "deck"} aria-label={deck.region}>
      <StopCell />
      {drives && <Stick />}
      <Slot />
      {hasRobot && <Heading />}
      {drives && <Turn />}
    </section>
  );
}

/** Slider that turns; left turns left, counter-clockwise seen from above. */
function Turn() {
  const session = useSession();
  const { drive, link } = session;
  const { deck } = texts();
  const control = useSprungSlider(drive, "turn", true);
  const off = whyOff(session);
  const { turn } = drive.asked.value;
  const allowed = isCurrent(freshness(link)) ? (drive.allowed.value?.turn ?? null) : null;
  return (
    <div class="turn">
      <span class="lab">{deck.axes.turn}</span>
      <SprungSlider
        label={deck.axes.turn}
        control={control}
        asked={turn}
        allowed={allowed}
        most={drive.scale.value.turn}
        spoken={spokenOf("turn", turn, "rad/s")}
        mirrored
        ends={["‹", "›"]}
        off={off !== null}
        refused={off?.text}
        looksOnly={drive.looksOnly.value}
      />
      <span class="lab">{off?.short ?? "rad/s"}</span>
    </div>
  );
}
