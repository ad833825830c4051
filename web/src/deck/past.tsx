// In a recording: the time looked at, what the robot itself does now, and the way back.

import { useComputed, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { FleetRobot } from "../generated/wire";
import { useSession } from "../session";
import { nameOf } from "../text/reasons";
import { language, texts } from "../text/text";
import { NextStep } from "../ui/button";

/** Leave the recording for the live robot. */
export function goLive(): void {
  const address = new URL(location.href);
  address.searchParams.delete("recording");
  location.assign(address);
}

export function Past() {
  const { link, keyboard } = useSession();
  const { deck, common } = texts();
  const startMs = useSignal<number | null>(null);
  const at_s = useSignal(0);
  const robots = useSignal<readonly FleetRobot[]>([]);
  useEffect(() => {
    const ask = () => link.send({ t: "fleet", on: true });
    const ends = [
      link.on("timeline", ({ start_ms }) => (startMs.value = start_ms)),
      link.on("cursor", ({ t_s }) => (at_s.value = t_s)),
      link.on("welcome", ask),
      link.on("fleet", ({ whole, robots: heard }) => {
        const kept = robots.peek().filter(({ id }) => heard.every((each) => each.id !== id));
        robots.value = whole ? heard : [...kept, ...heard];
      }),
      keyboard.bind("KeyL", goLive),
    ];
    ask();
    return () => ends.forEach((end) => end());
  }, [link]);
  const clock = useComputed(() => {
    if (startMs.value === null) return null;
    return new Date(startMs.value + 1000 * at_s.value).toLocaleTimeString(language.value);
  }).value;
  const id = link.robot.value?.id;
  const now = robots.value.find((each) => each.id === id && each.source === "robot");
  const mode = common.modes[now?.mode ?? ""];
  const driver = now?.driver ? (now.operators[now.driver] ?? nameOf(now.driver)) : null;
  return (
    <>
      <p>
        <b>{clock !== null && deck.past(clock)}</b>{" "}
        <span>
          {now && (now.silent || mode === undefined ? deck.gone : deck.now(mode, driver))}
        </span>
      </p>
      <NextStep onPress={goLive}>
        {deck.live} <kbd>L</kbd>
      </NextStep>
    </>
  );
}
