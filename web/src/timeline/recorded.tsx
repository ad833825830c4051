// A recording: playback controls and lanes for mode, driver, speed, link and events.

import { useEffect, useState } from "preact/hooks";
import { useSession } from "../session";
import { figure } from "../text/numbers";
import { sentence } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import type { IconName } from "../ui/icon";
import { Menu } from "../ui/menu";
import { Lanes } from "./lanes";
import { recordingsOpen } from "./library";
import { LineForm } from "./line_form";
import { backToLive, shared } from "./past";
import { type Playback, playbackOf, SPEEDS } from "./playback";

const NOTE_LENGTH = 200;

export function Recorded() {
  const { link, keyboard, notice } = useSession();
  const playback = playbackOf(link);
  const [noting, setNoting] = useState(false);
  const { timeline } = texts();
  const mark = () => {
    playback.pause(); // The note belongs to this time.
    setNoting(true);
  };
  useEffect(() => {
    const ends = [
      keyboard.bind("KeyL", backToLive),
      keyboard.bind("KeyK", () => playback.toggle()),
      keyboard.bind("KeyM", mark),
      // With Shift, one status instead of an event, on any keyboard layout.
      keyboard.bind("Comma", ({ key }) => (key === "," ? playback.jump(-1) : playback.step(-1))),
      keyboard.bind("Period", ({ key }) => (key === "." ? playback.jump(1) : playback.step(1))),
      link.on("reply", ({ to, ok, why }) => {
        if (to === "mark" && !ok && why) notice.say(sentence(why));
      }),
    ];
    return () => ends.forEach((end) => end());
  }, [playback]);
  return (
    <footer class="time past" aria-label={timeline.name}>
      <div class="head">
        <Controls playback={playback} />
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
          <Actions playback={playback} onMark={mark} />
        )}
      </div>
      <Lanes playback={playback} />
    </footer>
  );
}

function Controls({ playback }: { playback: Playback }) {
  const { timeline } = texts();
  const { playing } = playback.cursor.value;
  const times = (speed: number) =>
    timeline.times(figure(speed, speed < 1 ? (speed === 0.25 ? 2 : 1) : 0));
  return (
    <>
      <Button icon="previous" label={timeline.previousEvent} onPress={() => playback.jump(-1)} />
      <Button
        class="step turned"
        icon="right"
        label={timeline.stepBack}
        onPress={() => playback.step(-1)}
      />
      <Button
        edge
        icon={playing ? "pause" : "play"}
        label={playing ? timeline.pause : timeline.play}
        onPress={() => playback.toggle()}
      />
      <Button class="step" icon="right" label={timeline.stepOn} onPress={() => playback.step(1)} />
      <Button icon="next" label={timeline.nextEvent} onPress={() => playback.jump(1)} />
      <Menu
        label={`${timeline.speed}, ${times(playback.speed.value)}`}
        button={times(playback.speed.value)}
        items={SPEEDS.map((speed) => ({
          text: times(speed),
          checked: speed === playback.speed.value,
          onChoose: () => playback.setSpeed(speed),
        }))}
      />
    </>
  );
}

function Actions({ playback, onMark }: { playback: Playback; onMark: () => void }) {
  const { layout, link, notice } = useSession();
  const { timeline } = texts();
  const share = async () => notice.say(await shared(link.recording!, playback.cursor.peek().t_s));
  const phone = layout.phone.value;
  const button = (icon: IconName | undefined, label: string, onPress: () => void) => (
    <Button icon={icon} label={phone ? label : undefined} onPress={onPress}>
      {phone ? undefined : label}
    </Button>
  );
  return (
    <>
      {button("flag", timeline.mark, onMark)}
      {button("share", timeline.share, () => void share())}
      {button(
        phone ? "search" : undefined,
        timeline.recordings,
        () => (recordingsOpen.value = true),
      )}
    </>
  );
}
