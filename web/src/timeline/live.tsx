// One line: the last 30 s of the live robot, with its modes and events. A click looks back.

import { useEffect } from "preact/hooks";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import type { Link } from "../store/link";
import { duration, figure } from "../text/numbers";
import { sentence } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import { type Happening, Happenings, kindOf, useWidth } from "./happenings";
import { type Library, recordingsOpen } from "./library";
import { BACK_S, type LookBack } from "./look_back";
import { sliderHandlers } from "./slider";

const KEY_STEP_S = 5;
const SPAN_MS = 1000 * BACK_S;

export function Live({ back, library }: { back: LookBack; library: Library }) {
  const { keyboard, layout } = useSession();
  useEffect(() => {
    const ends = [
      keyboard.bind("KeyB", () => back.look((back.agoS.peek() ?? 0) + KEY_STEP_S)),
      keyboard.bind("KeyL", () => back.live()),
    ];
    return () => ends.forEach((end) => end());
  }, [back, keyboard]);
  const { timeline } = texts();
  const phone = layout.phone.value;
  return (
    <footer class="time now" aria-label={timeline.name}>
      <State back={back} />
      {!phone && <span class="note">{timeline.last(figure(BACK_S))}</span>}
      <Lane back={back} />
      <Side back={back} library={library} />
      <Button
        icon={phone ? "search" : undefined}
        label={phone ? timeline.recordings : undefined}
        expanded={recordingsOpen.value}
        onPress={() => (recordingsOpen.value = true)}
      >
        {phone ? undefined : timeline.recordings}
      </Button>
    </footer>
  );
}

/** What is shown; while it is the past, a button back to now. */
function State({ back }: { back: LookBack }) {
  const { link } = useSession();
  const { timeline } = texts();
  void link.beat.value;
  const { kind } = freshness(link);
  const ago = back.agoS.value;
  return (
    <span role="status">
      {ago === null ? (
        <span class={`shown ${kind}`}>
          <i class={kind === "live" ? "dot" : "dot hollow"} />
          {timeline.states[kind]}
        </span>
      ) : (
        <button
          type="button"
          class="shown back"
          title={timeline.backToNow}
          onClick={() => back.live()}
        >
          <Icon name="close" />
          {timeline.ago(figure(ago, 1))}
        </button>
      )}
    </span>
  );
}

function Lane({ back }: { back: LookBack }) {
  const { link } = useSession();
  const [ref, width] = useWidth<HTMLDivElement>();
  const { timeline } = texts();
  void link.beat.value;
  const nowMs = performance.now();
  const ago = back.agoS.value;
  const at = (ms: number) => Math.max(0, 1 - (nowMs - ms) / SPAN_MS);
  const percent = (share: number) => `${(100 * share).toFixed(2)}%`;
  const handlers = sliderHandlers(
    (share) => back.look(BACK_S * (1 - share)),
    (seconds) => back.look(Math.max(0, (back.agoS.peek() ?? 0) - seconds)),
  );
  return (
    <div class="lane" ref={ref}>
      <div
        {...handlers}
        class="rail"
        aria-label={timeline.slider}
        aria-valuemin={-BACK_S}
        aria-valuemax={0}
        aria-valuenow={-(ago ?? 0)}
        aria-valuetext={ago === null ? timeline.now : timeline.ago(figure(ago, 1))}
      >
        <svg aria-hidden="true">
          <line class="none" x1="0" x2="100%" y1="50%" y2="50%" />
          {back.modes.map(({ mode, fromMs, toMs }) => (
            <line
              key={fromMs}
              class={`m-${mode}`}
              x1={percent(at(fromMs))}
              x2={percent(at(toMs))}
              y1="50%"
              y2="50%"
            />
          ))}
        </svg>
        <i
          class={ago === null ? "cursor" : "cursor back"}
          style={{ left: percent(1 - (ago ?? 0) / BACK_S) }}
        />
      </div>
      <Happenings list={recent(link)} roomPx={width} onChoose={({ agoS }) => back.look(agoS)} />
    </div>
  );
}

function recent(link: Link): (Happening & { agoS: number })[] {
  const nowMs = Date.now();
  return link.history.value.flatMap((event) => {
    const [kind, agoS] = [kindOf(event), (nowMs - event.atMs) / 1000];
    if (kind === null || agoS > BACK_S || agoS < 0) return [];
    const title = `${texts().timeline.ago(figure(agoS))}: ${sentence(event.why)}`;
    return [{ at: 1 - agoS / BACK_S, kind, label: "", title, agoS }];
  });
}

/** The past state that is drawn, or how long the recorder has been writing. */
function Side({ back, library }: { back: LookBack; library: Library }) {
  const { link } = useSession();
  const { common, timeline } = texts();
  void link.beat.value;
  const robot = link.robot.value;
  const written = library.written.value;
  if (back.agoS.value !== null) {
    const past = back.past.value;
    const [vx, vy] = past?.twist ?? [];
    const onFloor = robot?.space === "floor" && vx !== undefined && vy !== undefined;
    return (
      <span class="side warn">
        {past ? (common.modes[past.mode] ?? past.mode) : timeline.nothingKept}
        {onFloor && ` ${figure(Math.hypot(vx, vy), 2)} m/s`}
      </span>
    );
  }
  const isKnown = written !== null && robot !== null && isCurrent(freshness(link));
  // It keeps its room, so that the lane stays below the pointer.
  if (!isKnown || !written.row.robots.includes(robot.id)) return <span class="side" />;
  const lengthS = written.row.duration_s + (performance.now() - written.atMs) / 1000;
  return (
    <span class="side">
      <i class="dot" />
      {timeline.recording(duration(lengthS))}
    </span>
  );
}
