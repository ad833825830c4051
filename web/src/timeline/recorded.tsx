// A recording: playback controls and lanes for mode, driver, speed, link and events.

import { useEffect, useState } from "preact/hooks";
import type { Key } from "../drive/keyboard";
import type { RecordedLanes, Timeline } from "../generated/wire";
import { useSession } from "../session";
import { nameOf, sentence } from "../text/reasons";
import { duration, figure, language, texts } from "../text/text";
import { Button } from "../ui/button";
import { LineForm } from "../ui/line_form";
import { Menu } from "../ui/menu";
import { shareAt, sliderHandlers, sliderValue } from "../ui/slider";
import { clock, Moment, ticks } from "./clock";
import { type Happening, Happenings } from "./happenings";
import { backToLive } from "./library";
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
  const keys = {
    KeyL: backToLive,
    KeyK: () => playback.toggle(),
    KeyM: mark,
    // With Shift, one status instead of an event, on any keyboard layout.
    Comma: ({ key }: Key) => (key === "," ? playback.jump(-1) : step(-1)),
    Period: ({ key }: Key) => (key === "." ? playback.jump(1) : step(1)),
  };
  useEffect(() => keyboard.bind(keys), [playback]);
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
            <Button icon="flag" label={timeline.mark} onPress={mark}>
              <span class="word">{timeline.mark}</span>
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

function Lanes() {
  const { link, playback } = useSession();
  const timeline = playback.timeline.value;
  const lanes = playback.lanes.value.find(({ robot }) => robot === link.robot.value?.id);
  return (
    <div class="lanes">
      <div class="names" aria-hidden="true">
        {Object.values(texts().timeline.lanes).map((name) => (
          <span key={name}>{name}</span>
        ))}
      </div>
      <div class="plane">
        {timeline && (
          <>
            <div class="grid" aria-hidden="true">
              {ticks(timeline.start_ms, timeline.duration_s).map(({ tS, text }) => (
                <span key={tS} style={{ left: `${(100 * tS) / timeline.duration_s}%` }}>
                  {text}
                </span>
              ))}
            </div>
            {lanes && <Values lanes={lanes} durationS={timeline.duration_s} />}
            <Rail timeline={timeline} lanes={lanes} />
            <Happenings list={happenings(timeline)} onSeek={(tS) => playback.seek(tS)} />
          </>
        )}
      </div>
    </div>
  );
}

/** Samples of the robot; a recording that grows is longer than they are. */
function Values({ lanes, durationS }: { lanes: RecordedLanes; durationS: number }) {
  const { common, timeline } = texts();
  const part = (lane: string, { from, to }: Span<unknown>, text = "") => (
    <span
      key={`${lane} ${from}`}
      class={`span ${lane}`}
      title={text}
      style={{ left: `${100 * from}%`, width: `${100 * (to - from)}%` }}
    >
      <bdi>{text}</bdi>
    </span>
  );
  return (
    <div
      class="values"
      style={{ width: `${100 * Math.min(1, lanes.end_s / durationS)}%` }}
      aria-hidden="true"
    >
      {spans(lanes.modes).map((span) =>
        span.value === null
          ? part("link gap", span, timeline.silent(duration((span.to - span.from) * lanes.end_s)))
          : [
              part("link", span),
              part(`mode m-${span.value}`, span, common.modes[span.value] ?? span.value),
            ],
      )}
      {spans(lanes.drivers).map((span) => span.value && part("driver", span, nameOf(span.value)))}
      <svg class="speed" viewBox="0 0 1 1" preserveAspectRatio="none">
        <path d={linePath(lanes.speeds)} />
      </svg>
    </div>
  );
}

/** The slider over all lanes, and the line of the time shown. */
function Rail({ timeline, lanes }: { timeline: Timeline; lanes: RecordedLanes | undefined }) {
  const { playback } = useSession();
  const { start_ms: startMs, duration_s: durationS } = timeline;
  const tS = playback.cursor.value.t_s;
  const shownMs = startMs + 1000 * tS;
  const words = [clock(shownMs), ...(lanes ? told(lanes, tS) : [])];
  return (
    <div
      {...sliderHandlers(
        (share) => playback.seek(share * durationS),
        (seconds) => playback.seek(playback.cursor.peek().t_s + seconds),
      )}
      class="rail"
      aria-label={texts().timeline.recordedSlider}
      {...sliderValue(0, durationS, tS, words.join(", "))}
      style={{ "--at": `${100 * shareAt(tS, 0, durationS)}%` }}
    >
      <i class="cursor">
        <Moment atMs={shownMs}>{clock(shownMs)}</Moment>
      </i>
    </div>
  );
}

/** Mode, driver and speed at a time, in words. */
function told({ modes, drivers, speeds, end_s }: RecordedLanes, tS: number): string[] {
  const { common, timeline } = texts();
  const i = Math.round(shareAt(tS, 0, end_s) * (modes.length - 1));
  const [mode, driver, speed] = [modes[i], drivers[i], speeds[i]];
  return [
    mode ? (common.modes[mode] ?? mode) : timeline.states.silent,
    driver ? nameOf(driver) : "",
    speed ? `${timeline.lanes.speed} ${figure(speed, 2)}` : "",
  ].filter(Boolean);
}

function happenings({ events, start_ms, duration_s }: Timeline): Happening[] {
  const several = new Set(events.map(({ robot }) => robot)).size > 2; // One is "", for marks.
  return events.map(({ t_s: atS, robot, kind, why, text, count }) => {
    const who = several && robot !== "" ? `${robot}: ` : "";
    // Notes and old events have no reason.
    const whole = why ? sentence(why) : text || (texts().timeline.kinds[kind] ?? kind);
    // The cause of a stop rather than the change of the mode.
    const short = why ? sentence(why.cause ?? why).slice(0, -1) : whole;
    return {
      atS,
      share: shareAt(atS, 0, duration_s),
      kind,
      label: count > 1 ? `${who}${short} × ${count}` : who + short,
      title: `${clock(start_ms + 1000 * atS)} ${who}${whole}`,
    };
  });
}

export interface Span<T> {
  value: T;
  /** Fractions of the time with samples. */
  from: number;
  to: number;
}

/** Join equal samples at even times from 0 to 1 to spans; borders are midway between samples. */
export function spans<T>(samples: readonly T[]): Span<T>[] {
  const joined: Span<T>[] = [];
  const last = Math.max(1, samples.length - 1);
  const border = (i: number) => Math.max(0, Math.min(1, (i - 0.5) / last));
  samples.forEach((value, i) => {
    const before = joined.at(-1);
    if (before && before.value === value) before.to = border(i + 1);
    else joined.push({ value, from: border(i), to: border(i + 1) });
  });
  return joined;
}

/** Path through samples in a square of 1, with gaps between them; it fills the height. */
export function linePath(samples: readonly (number | null)[]): string {
  const most = Math.max(0.1, ...samples.map((value) => value ?? 0));
  const last = Math.max(1, samples.length - 1);
  return samples
    .map((value, i) => {
      if (value === null) return "";
      const command = (samples[i - 1] ?? null) === null ? "M" : "L";
      return `${command}${(i / last).toFixed(4)} ${(1 - value / most).toFixed(3)}`;
    })
    .join("");
}
