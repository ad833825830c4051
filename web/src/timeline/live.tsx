// One line: the last 30 s of the live robot, with its modes and events. A click looks back.

import { useEffect } from "preact/hooks";
import { isOnFloor } from "../drive/axes";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import type { Link } from "../store/link";
import { sentence } from "../text/reasons";
import { degrees, duration, figure, texts } from "../text/text";
import { Icon } from "../ui/icon";
import { sliderHandlers, sliderValue } from "../ui/slider";
import { type Happening, Happenings } from "./happenings";
import { BACK_S } from "./look_back";
import { ListButton } from "./recordings";

const KEY_STEP_S = 5;
const STEP_MS = 100; // Less than half of it cannot be seen.

export function Live() {
  const { keyboard, link, lookBack } = useSession();
  const { timeline } = texts();
  useEffect(() => {
    const back = () => lookBack.look((lookBack.agoS.peek() ?? 0) + KEY_STEP_S);
    return keyboard.bind({ KeyB: back, KeyL: () => lookBack.look(0) });
  }, [lookBack, keyboard]);
  const nowMs = STEP_MS * Math.round(performance.now() / STEP_MS);
  const { kind } = freshness(link);
  const agoS = lookBack.agoS.value;
  const ago = agoS === null ? null : timeline.ago(figure(agoS, 1));
  const seek = (atS: number) => lookBack.look(-atS);
  return (
    <footer class="time now" aria-label={timeline.name}>
      <span role="status">
        {ago === null ? (
          <span class={`shown ${kind}`}>
            <i class="dot" />
            {timeline.states[kind]}
          </span>
        ) : (
          <button
            type="button"
            class="shown back"
            title={timeline.backToNow}
            onClick={() => seek(0)}
          >
            <Icon name="close" />
            {ago}
          </button>
        )}
      </span>
      <span class="note">{timeline.last(figure(BACK_S))}</span>
      <div class="lane">
        <div
          {...sliderHandlers(
            (share) => seek(BACK_S * (share - 1)),
            (seconds) => seek(seconds - (lookBack.agoS.peek() ?? 0)),
          )}
          class="rail"
          aria-label={timeline.slider}
          {...sliderValue(-BACK_S, 0, -(agoS ?? 0), ago ?? timeline.now)}
          style={{ "--at": `${100 - (100 * (agoS ?? 0)) / BACK_S}%` }}
        >
          <svg viewBox={`${-BACK_S} 0 ${BACK_S} 2`} preserveAspectRatio="none" aria-hidden="true">
            <path d={`M${-BACK_S} 1H0`} />
            {lookBack.modes.map(({ mode, fromMs, toMs }) => (
              <path
                key={fromMs}
                class={`m-${mode}`}
                d={`M${(fromMs - nowMs) / 1000} 1H${(toMs - nowMs) / 1000}`}
              />
            ))}
          </svg>
          <i class={ago === null ? "cursor" : "cursor back"} />
        </div>
        <Happenings list={recent(link)} onSeek={seek} />
      </div>
      {agoS === null ? <Recorder /> : <PastState />}
      <ListButton />
    </footer>
  );
}

/** Mode and speed of the state that is drawn, with its place. */
function PastState() {
  const { link, lookBack } = useSession();
  const past = lookBack.past.value;
  const [vx, vy] = past?.twist ?? [];
  const [x, y, heading] = past?.pose ?? [];
  const onFloor = isOnFloor(link.robot.value);
  const place = `x ${figure(x, 2)} m, y ${figure(y, 2)} m, ${figure(degrees(heading))}°`;
  return (
    <span class="side warn" title={onFloor && past?.pose ? place : undefined}>
      {past ? (texts().common.modes[past.mode] ?? past.mode) : texts().timeline.nothingKept}
      {onFloor && vx !== undefined && vy !== undefined && ` ${figure(Math.hypot(vx, vy), 2)} m/s`}
    </span>
  );
}

/** For how long the recorder has been writing. */
function Recorder() {
  const { library, link } = useSession();
  const written = library.written.value;
  const robot = link.robot.value?.id ?? "";
  // It keeps its room, so that the lane stays below the pointer.
  if (!isCurrent(freshness(link)) || !written?.row.robots.includes(robot))
    return <span class="side" />;
  const lengthS = written.row.duration_s + (performance.now() - written.atMs) / 1000;
  return (
    <span class="side">
      <i class="dot" />
      {texts().timeline.recording(duration(lengthS))}
    </span>
  );
}

/** Kinds in recordings by kinds of live events, and by the mode after a change. */
const KINDS: Record<string, string> = {
  fault: "fault",
  stopped: "stop",
  stopping: "stop",
  drop: "drop",
  lease: "hand-over",
  consistency: "consistency",
};

function recent(link: Link): Happening[] {
  const nowMs = STEP_MS * Math.round(Date.now() / STEP_MS);
  return link.history.value.flatMap(({ kind: name, why, atMs }) => {
    const kind = KINDS[name === "mode" ? String(why.params?.["after"]) : name];
    const agoS = (nowMs - atMs) / 1000;
    if (kind === undefined || agoS > BACK_S || agoS < 0) return [];
    const title = `${texts().timeline.ago(figure(agoS))}: ${sentence(why)}`;
    return [{ atS: -agoS, share: 1 - agoS / BACK_S, kind, label: "", title }];
  });
}
