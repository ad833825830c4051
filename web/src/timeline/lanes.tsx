// Lanes of a recording, and the time that is shown.

import type { RecordedLanes, Timeline, TimelineEvent } from "../generated/wire";
import { useSession } from "../session";
import { duration, figure } from "../text/numbers";
import { nameOf, sentence } from "../text/reasons";
import { texts } from "../text/text";
import { clock, iso, ticks } from "./clock";
import { type Happening, Happenings, Rail, shareAt } from "./lane";

export function Lanes() {
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
            <Cursor timeline={timeline} lanes={lanes} />
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
  const silent = ({ from, to }: Span<unknown>) =>
    timeline.silent(duration((to - from) * lanes.end_s));
  return (
    <div
      class="values"
      style={{ width: `${100 * Math.min(1, lanes.end_s / durationS)}%` }}
      aria-hidden="true"
    >
      {spans(lanes.modes).map(
        (span) =>
          span.value && part(`mode m-${span.value}`, span, common.modes[span.value] ?? span.value),
      )}
      {spans(lanes.modes.map((mode) => mode === null)).map((span) =>
        span.value ? part("link gap", span, silent(span)) : part("link", span),
      )}
      {spans(lanes.drivers).map((span) => span.value && part("driver", span, nameOf(span.value)))}
      <svg class="speed" viewBox="0 0 1 1" preserveAspectRatio="none">
        <path d={linePath(lanes.speeds)} />
      </svg>
    </div>
  );
}

/** The slider over all lanes, and the line of the time shown. */
function Cursor({ timeline, lanes }: { timeline: Timeline; lanes: RecordedLanes | undefined }) {
  const { playback } = useSession();
  const tS = playback.cursor.value.t_s;
  const shownMs = timeline.start_ms + 1000 * tS;
  return (
    <Rail
      label={texts().timeline.recordedSlider}
      fromS={0}
      toS={timeline.duration_s}
      atS={tS}
      text={[clock(shownMs), ...(lanes ? told(lanes, tS) : [])].join(", ")}
      onSeek={(wantedS) => playback.seek(wantedS)}
    >
      <i class="cursor">
        <time dateTime={iso(shownMs)} title={iso(shownMs)}>
          {clock(shownMs)}
        </time>
      </i>
    </Rail>
  );
}

/** Mode, driver and speed at a time, in words. */
function told(lanes: RecordedLanes, tS: number): string[] {
  const last = lanes.modes.length - 1;
  const i = lanes.end_s > 0 ? Math.min(last, Math.round((tS / lanes.end_s) * last)) : 0;
  const [mode, driver, speed] = [lanes.modes[i], lanes.drivers[i], lanes.speeds[i]];
  const { common, timeline } = texts();
  return [
    mode ? (common.modes[mode] ?? mode) : timeline.states.silent,
    driver ? nameOf(driver) : "",
    speed ? `${timeline.lanes.speed} ${figure(speed, 2)}` : "",
  ].filter(Boolean);
}

function happenings({ events, start_ms: startMs, duration_s: durationS }: Timeline): Happening[] {
  const several = new Set(events.map(({ robot }) => robot)).size > 2; // One is "", for marks.
  return events.map((event) => {
    const { t_s: atS, robot, kind } = event;
    const who = several && robot !== "" ? `${robot}: ` : "";
    const title = `${clock(startMs + 1000 * atS)} ${who}${textOf(event)}`;
    return { atS, share: shareAt(atS, 0, durationS), kind, label: who + labelOf(event), title };
  });
}

/** Text of a recorded event; notes and old events have no reason. */
function textOf({ why, text, kind }: TimelineEvent): string {
  return why ? sentence(why) : text || (texts().timeline.kinds[kind] ?? kind);
}

/** A few words for a label: the cause of a stop rather than the change of the mode. */
function labelOf(event: TimelineEvent): string {
  const why = event.why?.cause ?? event.why;
  const label = why ? sentence(why).slice(0, -1) : textOf(event);
  return event.count > 1 ? `${label} × ${event.count}` : label;
}

export interface Span<T> {
  value: T;
  /** Shares of the time for which there are samples. */
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

/** Path through samples in a square of 1, with gaps where there are none; it fills the height. */
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
