// A recording: playback controls and lanes for mode, driver, speed, link and events.

import { useEffect, useState } from "preact/hooks";
import { goLive } from "../deck/past";
import { useSession } from "../session";
import { language, texts } from "../text/text";
import { Button, type ButtonProps } from "../ui/button";
import { Menu } from "../ui/menu";
import { WordButton } from "./lane";
import { Lanes } from "./lanes";
import { LineForm } from "./line_form";
import { shared, SPEEDS } from "./playback";

const NOTE_LENGTH = 200;

export function Recorded() {
  const { keyboard, library, link, notice, playback } = useSession();
  const { timeline } = texts();
  const [noting, setNoting] = useState(false);
  const mark = () => {
    playback.pause(); // The note belongs to this time.
    setNoting(true);
  };
  const share = async () => notice.say(await shared(link.recording!, playback.cursor.peek().t_s));
  useEffect(() => {
    const ends = [
      keyboard.bind("KeyL", goLive),
      keyboard.bind("KeyK", () => playback.toggle()),
      keyboard.bind("KeyM", mark),
      // With Shift, one status instead of an event, on any keyboard layout.
      keyboard.bind("Comma", ({ key }) => (key === "," ? playback.jump(-1) : playback.step(-1))),
      keyboard.bind("Period", ({ key }) => (key === "." ? playback.jump(1) : playback.step(1))),
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
            onSend={(note) => note !== "" && playback.mark(note)}
            onClose={() => setNoting(false)}
          />
        ) : (
          <>
            <WordButton icon="flag" text={timeline.mark} onPress={mark} />
            <WordButton icon="share" text={timeline.share} onPress={() => void share()} />
            <WordButton
              icon="search"
              text={timeline.recordings}
              onPress={() => (library.open.value = true)}
            />
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
  const buttons: ButtonProps[] = [
    { icon: "previous", label: timeline.previousEvent, onPress: () => playback.jump(-1) },
    {
      icon: "right",
      class: "step turned",
      label: timeline.stepBack,
      onPress: () => playback.step(-1),
    },
    {
      icon: playing ? "pause" : "play",
      edge: true,
      label: playing ? timeline.pause : timeline.play,
      onPress: () => playback.toggle(),
    },
    { icon: "right", class: "step", label: timeline.stepOn, onPress: () => playback.step(1) },
    { icon: "next", label: timeline.nextEvent, onPress: () => playback.jump(1) },
  ];
  return (
    <>
      {buttons.map((button, i) => (
        <Button key={i} {...button} />
      ))}
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
