// Left of STOP: the next step with its sentence, or the speed while one drives.

import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { HeldKeys, HeldPointer } from "../drive/held";
import { useSession } from "../session";
import { refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Button, NextStep } from "../ui/button";
import { Past } from "./past";
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
  const alone = session.drive.alone.value;
  const classes = ["slot", step.id === "speed" ? "speedcell" : "nextcell"];
  return (
    <div ref={box} class={classes.join(" ")} data-step={step.id} tabIndex={-1}>
      {step.id === "speed" && <Speed />}
      {step.id === "past" && <Past />}
      {step.title !== undefined && <Words step={step} />}
      {alone && <p class="alone warn">{texts().deck.alone}</p>}
      {step.progress !== undefined && <Progress step={step} />}
      <div class="do">
        {step.quiet && <Quiet action={step.quiet} />}
        {step.next && <Next key={step.id} action={step.next} />}
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
  const at = name === "" ? -1 : title.indexOf(name);
  const isAlarm = step.id === "unconfirmed";
  const refused = next?.refused ? refusalText(next.refused) : null;
  const kind = next && typeof next.does === "object" ? next.does.t : null;
  const answer = kind === null ? null : requests.isPending(kind) ? deck.sent : null;
  const missed = kind !== null && requests.unanswered.value === kind ? `${common.noAnswer}.` : null;
  return (
    <p role={isAlarm ? "alert" : undefined} title={[title, step.detail].filter(Boolean).join(" ")}>
      <b aria-live={isAlarm ? undefined : "polite"}>
        {at < 0 ? title : title.slice(0, at)}
        {at >= 0 && <bdi>{name}</bdi>}
        {at >= 0 && title.slice(at + name.length)}
      </b>{" "}
      <span>{[step.detail, refused].filter(Boolean).join(" ")}</span>{" "}
      <span class="warn" role="status">
        {answer ?? missed}
      </span>
    </p>
  );
}

function Progress({ step }: { step: Step }) {
  const percent = Math.round(100 * Math.min(1, step.progress ?? 0));
  return (
    <div
      class="done"
      role="progressbar"
      aria-label={step.title}
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={percent}
    >
      <i style={{ width: `${percent}%` }} />
    </div>
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
  const button = useRef<HTMLButtonElement>(null);
  useEffect(() => {
    const node = button.current!;
    const keys = new HeldKeys();
    const pointer = new HeldPointer(node, {
      came: () => path.hold() || pointer.cancel(),
      gone: () => path.letGo(),
    });
    const press = (event: KeyboardEvent) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      if (!keys.take(event)) return;
      if (keys.size === 0) path.letGo();
      else if (!path.hold()) keys.cancel();
    };
    const left = () => keys.cancel() && path.letGo();
    node.addEventListener("keydown", press);
    node.addEventListener("keyup", press);
    node.addEventListener("blur", left);
    return () => {
      path.letGo();
      pointer.end();
    };
  }, [path]);
  const refusal = path.whyNotGo();
  const classes = path.going.value ? "next held" : "next";
  return (
    <button
      ref={button}
      type="button"
      class={classes}
      aria-disabled={refusal !== null || undefined}
      title={refusal === null ? undefined : refusalText(refusal)}
    >
      <span>
        {texts().deck.go} <kbd>G</kbd>
      </span>
    </button>
  );
}
