// A recording: playback controls and lanes for mode, driver, speed, link and events.

import { useEffect, useState } from "preact/hooks";
import { goLive } from "../deck/past";
import { useSession } from "../session";
import { language, texts } from "../text/text";
import { Button } from "../ui/button";
import { Menu } from "../ui/menu";
import { Lanes } from "./lanes";
import { LineForm } from "./line_form";
import { SPEEDS } from "./playback";
import { ListButton } from "./recordings";

const NOTE_LENGTH = 200;

export function Recorded() {
  const { keyboard, link, playback } = useSession();
  const { timeline } = texts();
  const [noting, setNoting] = useState(false);
  const mark = () => {
    link.send({ t: "pause" }); // The note belongs to this time.
    setNoting(true);
  };
  const step = (way: 1 | -1) => link.send({ t: "step", back: way < 0 });
  useEffect(() => {
    const ends = [
      keyboard.bind("KeyL", goLive),
      keyboard.bind("KeyK", () => playback.toggle()),
      keyboard.bind("KeyM", mark),
      // With Shift, one status instead of an event, on any keyboard layout.
      keyboard.bind("Comma", ({ key }) => (key === "," ? playback.jump(-1) : step(-1))),
      keyboard.bind("Period", ({ key }) => (key === "." ? playback.jump(1) : step(1))),
    ];
    return () => ends.forEach((end) => end());
  }, [playback]);
  return (
    <footer class="time past" aria-label={timeline.name}>
      <div class="head">
        <Controls />
        <span class="spacer" />
        {noting ? (
          <LineForm
            label={timeline.mark}
            hint={timeline.markHint}
            most={NOTE_LENGTH}
            onSend={(note) => note !== "" && link.send({ t: "mark", note })}
            onClose={() => setNoting(false)}
          />
        ) : (
          <>
            <Button icon="flag" onPress={mark}>
              {timeline.mark}
            </Button>
            <ListButton />
          </>
        )}
      </div>
      <Lanes />
    </footer>
  );
}

function Controls() {
  const { playback } = useSession();
  const { timeline } = texts();
  const { playing } = playback.cursor.value;
  const speed = playback.speed.value;
  const times = (factor: number) => timeline.times(factor.toLocaleString(language.value));
  return (
    <>
      <Button icon="previous" label={timeline.previousEvent} onPress={() => playback.jump(-1)} />
      <Button
        edge
        icon={playing ? "pause" : "play"}
        label={playing ? timeline.pause : timeline.play}
        onPress={() => playback.toggle()}
      />
      <Button icon="next" label={timeline.nextEvent} onPress={() => playback.jump(1)} />
      <Menu
        label={`${timeline.speed}, ${times(speed)}`}
        button={times(speed)}
        items={SPEEDS.map((each) => ({
          text: times(each),
          checked: each === speed,
          onChoose: () => playback.setSpeed(each),
        }))}
      />
    </>
  );
}
