// Left of STOP: the next step with its sentence, or the speed while one drives.

import { useEffect, useLayoutEffect, useMemo, useRef } from "preact/hooks";
import { CENTRED } from "../drive/axes";
import { SprungControl } from "../drive/sprung";
import { useSession } from "../session";
import { nameOf, refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { clock } from "../timeline/clock";
import { backToLive } from "../timeline/past";
import { playbackOf } from "../timeline/playback";
import { Button, NextStep } from "../ui/button";
import { Speed } from "./speed";
import { type Action, type Step, stepOf } from "./steps";

export function Slot() {
  const session = useSession();
  const step = stepOf(session);
  const box = useRef<HTMLDivElement>(null);
  const hadFocus = box.current?.contains(document.activeElement) ?? false;
  useLayoutEffect(() => {
    // The focus of a button that is gone goes to the next step, not to the top of the page.
    if (!hadFocus || box.current?.contains(document.activeElement)) return;
    (box.current?.querySelector<HTMLElement>("button.next") ?? box.current)?.focus();
  });
  const { id, title, progress, next, quiet } = step;
  const classes = id === "speed" ? "slot speedcell" : "slot nextcell";
  return (
    <div ref={box} class={classes} data-step={id} tabIndex={-1}>
      {id === "speed" && <Speed />}
      {id === "past" && <Past />}
      {title !== undefined && <Words step={step} />}
      {session.drive.alone.value && <p class="alone warn">{texts().deck.alone}</p>}
      {progress !== undefined && <progress class="done" aria-label={title} value={progress} />}
      <div class="do">
        {quiet && <Quiet action={quiet} />}
        {next && <Next key={id} action={next} />}
        {step.path && <HoldToGo key="path" />}
      </div>
    </div>
  );
}

/** What has happened, and what to do. */
function Words({ step }: { step: Step }) {
  const { requests } = useSession();
  const { deck, common } = texts();
  const { title = "", name = "", next } = step;
  const at = name === "" ? title.length : title.indexOf(name);
  const isAlarm = step.id === "unconfirmed";
  const refused = next?.refused ? refusalText(next.refused) : null;
  const kind = typeof next?.does === "object" ? next.does.t : undefined;
  return (
    <p role={isAlarm ? "alert" : undefined} title={[title, step.detail].filter(Boolean).join(" ")}>
      <b aria-live={isAlarm ? undefined : "polite"}>
        {title.slice(0, at)}
        {name && <bdi>{name}</bdi>}
        {title.slice(at + name.length)}
      </b>{" "}
      <span>{[step.detail, refused].filter(Boolean).join(" ")}</span>{" "}
      <span class="warn" role="status">
        {kind && requests.isPending(kind) && deck.sent}
        {kind && requests.unanswered.value === kind && `${common.noAnswer}.`}
      </span>
    </p>
  );
}

function useAction({ does, refused = null }: Action) {
  const { requests } = useSession();
  const isRequest = typeof does === "object";
  return {
    busy: isRequest && requests.isPending(does.t),
    refused: refused && refusalText(refused),
    onPress: () => (isRequest ? requests.send(does) : does()),
  };
}

function Next({ action }: { action: Action }) {
  return (
    <NextStep {...useAction(action)} hold={action.hold}>
      {action.text}
    </NextStep>
  );
}

function Quiet({ action }: { action: Action }) {
  const { refused, onPress } = useAction(action);
  return (
    <Button edge refused={refused} onPress={onPress}>
      {action.text}
    </Button>
  );
}

/** Follows the path while a finger, or Enter, holds it. */
function HoldToGo() {
  const { path } = useSession();
  const control = useMemo(
    () => new SprungControl(path, () => CENTRED, { Enter: {}, NumpadEnter: {} }),
    [path],
  );
  const refusal = path.whyNotGo();
  return (
    <button
      ref={control.attach}
      type="button"
      class={path.going.value ? "next held" : "next"}
      aria-disabled={refusal !== null || undefined}
      title={refusal === null ? undefined : refusalText(refusal)}
    >
      <span>
        {texts().deck.go} <kbd>G</kbd>
      </span>
    </button>
  );
}

/** In a recording: the time looked at, what the robot itself does now, and the way back. */
function Past() {
  const { link, fleet } = useSession();
  const { deck, common } = texts();
  useEffect(() => {
    const ask = () => link.send({ t: "fleet", on: true });
    ask();
    return link.on("welcome", ask);
  }, [link]);
  const shownMs = playbackOf(link).shownMs.value;
  const id = link.robot.value?.id;
  const now = fleet.rows().find((row) => row.id === id && row.source === "robot");
  const mode = common.modes[now?.mode ?? ""];
  const driver = now?.driver ? (now.operators[now.driver] ?? nameOf(now.driver)) : null;
  return (
    <>
      <p>
        <b>{shownMs !== null && deck.past(clock(shownMs))}</b>{" "}
        <span>
          {now && (now.silent || mode === undefined ? deck.gone : deck.now(mode, driver))}
        </span>
      </p>
      <NextStep onPress={backToLive}>
        {deck.live} <kbd>L</kbd>
      </NextStep>
    </>
  );
}
