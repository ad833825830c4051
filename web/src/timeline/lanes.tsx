// Lanes of a recording, and the time that is shown.

import { useMemo } from "preact/hooks";
import type { RecordedLanes, Timeline } from "../generated/wire";
import { useSession } from "../session";
import { duration, figure } from "../text/numbers";
import { nameOf } from "../text/reasons";
import { language, texts } from "../text/text";
import { clock, iso, ticks } from "./clock";
import { type Span, linePath, spans } from "./groups";
import { Happenings, labelOf, textOf, useWidth } from "./happenings";
import type { Playback } from "./playback";
import { sliderHandlers } from "./slider";

const NARROW_PX = 36; // A shorter span has no text.

export function Lanes({ playback }: { playback: Playback }) {
  const { link } = useSession();
  const [ref, width] = useWidth<HTMLDivElement>();
  const timeline = playback.timeline.value;
  const names = texts().timeline.lanes;
  const robot = link.robot.value?.id;
  const lanes = playback.lanes.value.find((each) => each.robot === robot);
  return (
    <div class="lanes">
      <div class="names" aria-hidden="true">
        {Object.values(names).map((name) => (
          <span key={name}>{name}</span>
        ))}
      </div>
      <div class="plane" ref={ref}>
        {timeline && (
          <>
            <Grid timeline={timeline} width={width} />
            {lanes && <Values lanes={lanes} timeline={timeline} width={width} />}
            <Rail playback={playback} timeline={timeline} lanes={lanes} />
            <Events playback={playback} timeline={timeline} width={width} />
          </>
        )}
      </div>
    </div>
  );
}

interface PartProps {
  timeline: Timeline;
  width: number;
}

function Grid({ timeline, width }: PartProps) {
  return (
    <div class="grid" aria-hidden="true">
      {ticks(timeline.start_ms, timeline.duration_s, width).map(({ tS, text }) => (
        <span key={tS} style={{ left: `${(100 * tS) / timeline.duration_s}%` }}>
          {text}
        </span>
      ))}
    </div>
  );
}

/** Samples of the robot; they change only when lanes are read again. */
function Values({ lanes, timeline, width }: PartProps & { lanes: RecordedLanes }) {
  const words = language.value;
  return useMemo(() => {
    const { common } = texts();
    // A recording that grows is longer than its lanes.
    const share = Math.min(1, lanes.end_s / Math.max(timeline.duration_s, 1e-3));
    const most = Math.max(0.1, ...lanes.speeds.map((speed) => speed ?? 0));
    const box = { width: `${100 * share}%` };
    const part = (span: Span<string | null>, lane: string, text: string, kind = "") => (
      <span
        key={`${lane} ${span.from}`}
        class={`span ${lane} ${kind}`}
        title={text}
        style={{ left: `${100 * span.from}%`, width: `${100 * (span.to - span.from)}%` }}
      >
        {(span.to - span.from) * share * width > NARROW_PX && <bdi>{text}</bdi>}
      </span>
    );
    const links = spans(lanes.modes.map((mode) => (mode === null ? "gap" : "ok")));
    const length = (span: Span<unknown>) => duration((span.to - span.from) * lanes.end_s);
    return (
      <div class="values" style={box} aria-hidden="true">
        {spans(lanes.modes).map(
          (span) =>
            span.value &&
            part(span, "mode", common.modes[span.value] ?? span.value, `m-${span.value}`),
        )}
        {spans(lanes.drivers).map((span) => span.value && part(span, "driver", nameOf(span.value)))}
        <svg class="speed" viewBox="0 0 1000 20" preserveAspectRatio="none">
          <path d={linePath(lanes.speeds, most)} />
        </svg>
        {links.map((span) =>
          part(
            span,
            "link",
            span.value === "gap" ? texts().timeline.silent(length(span)) : "",
            span.value,
          ),
        )}
      </div>
    );
  }, [lanes, timeline.duration_s, width, words]);
}

interface RailProps {
  playback: Playback;
  timeline: Timeline;
  lanes: RecordedLanes | undefined;
}

/** The slider over all lanes, and the line of the time shown. */
function Rail({ playback, timeline, lanes }: RailProps) {
  const tS = playback.cursor.value.t_s;
  const { duration_s: durationS, start_ms: startMs } = timeline;
  const shownMs = startMs + 1000 * tS;
  const percent = durationS > 0 ? (100 * tS) / durationS : 0;
  const handlers = sliderHandlers(
    (share) => playback.seek(share * durationS),
    (seconds) => playback.move(seconds),
  );
  return (
    <div
      {...handlers}
      class="rail"
      aria-label={texts().timeline.recordedSlider}
      aria-valuemin={0}
      aria-valuemax={durationS}
      aria-valuenow={tS}
      aria-valuetext={[clock(shownMs), ...(lanes ? told(lanes, tS) : [])].join(", ")}
    >
      <i class="cursor" style={{ left: `${percent}%` }}>
        <time
          dateTime={iso(shownMs)}
          title={iso(shownMs)}
          style={{ translate: `${-percent}%` }} // It stays inside at both ends.
        >
          {clock(shownMs)}
        </time>
      </i>
    </div>
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

function Events({ playback, timeline, width }: PartProps & { playback: Playback }) {
  const words = language.value;
  const robots = new Set(timeline.events.map(({ robot }) => robot)).size > 2; // One is "", for marks.
  const list = useMemo(
    () =>
      timeline.events.map((event) => {
        const time = clock(timeline.start_ms + 1000 * event.t_s);
        const who = robots && event.robot !== "" ? `${event.robot}: ` : "";
        const title = `${time} ${who}${textOf(event)}`;
        const at = event.t_s / Math.max(timeline.duration_s, 1e-3);
        return { at, kind: event.kind, label: who + labelOf(event), title, tS: event.t_s };
      }),
    [timeline, words],
  );
  if (width === 0) return null;
  return (
    <>
      <div class="exact" aria-hidden="true">
        {list.slice(0, 500).map(({ at, kind }, i) => (
          <i key={i} class={kind} style={{ left: `${100 * at}%` }} />
        ))}
      </div>
      <Happenings labels list={list} roomPx={width} onChoose={({ tS }) => playback.seek(tS)} />
    </>
  );
}
