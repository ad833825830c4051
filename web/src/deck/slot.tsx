// Left of STOP: the next step with its sentence, or the speed while one drives.

import { useLayoutEffect, useMemo, useRef } from "preact/hooks";
import { CENTRED } from "../drive/axes";
import { SprungControl } from "../drive/sprung";
import { useSession } from "../session";
import { refusalText, words } from "../text/reasons";
import { figure, texts } from "../text/text";
import { Button, NextStep } from "../ui/button";
import { sliderHandlers, sliderValue } from "../ui/slider";
import { type Action, speedOf, type Step, stepOf, unitOf } from "./steps";

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
      {title !== undefined && <Words step={step} />}
      {session.drive.alone.value && <p class="alone warn">{texts().deck.alone}</p>}
      {progress !== undefined && <progress class="done" aria-label={title} value={progress} />}
      <div class="do">
        {quiet && <Act action={quiet} isQuiet />}
        {next && <Act key={id} action={next} />}
        {step.path && <HoldToGo key="path" />}
      </div>
    </div>
  );
}

const LONG = 90; // Characters that may have to be small, or scroll.

function Words({ step }: { step: Step }) {
  const { requests } = useSession();
  const { deck, common } = texts();
  const { title = "", name = "", next } = step;
  const at = name === "" ? title.length : title.indexOf(name);
  const isAlarm = step.id === "unconfirmed";
  const isSpoken = !isAlarm && step.id !== "past"; // The time runs.
  const refused = next?.refused ? refusalText(next.refused) : null;
  const kind = typeof next?.does === "object" ? next.does.t : undefined;
  const rest = [step.detail, refused].filter(Boolean).join(" ");
  const isLong = title.length + rest.length > LONG;
  return (
    <p
      class={isLong ? "long" : undefined}
      role={isAlarm ? "alert" : undefined}
      tabIndex={isLong ? 0 : undefined}
    >
      <b aria-live={isSpoken ? "polite" : undefined}>
        {title.slice(0, at)}
        {name && <bdi>{name}</bdi>}
        {title.slice(at + name.length)}
      </b>{" "}
      <span>{rest}</span>{" "}
      <span class="warn" role="status">
        {kind && requests.pending.value === kind && deck.sent}
        {kind && requests.unanswered.value === kind && `${common.noAnswer}.`}
      </span>
    </p>
  );
}

function Act({ action, isQuiet = false }: { action: Action; isQuiet?: boolean }) {
  const { requests } = useSession();
  const { text, does, refused, hold, key } = action;
  const isRequest = typeof does === "object";
  const act = {
    refused: refused ? refusalText(refused) : null,
    onPress: () => (isRequest ? requests.send(does) : does()),
  };
  if (isQuiet) return <Button edge {...act} children={text} />;
  return (
    <NextStep {...act} hold={hold} busy={isRequest && requests.pending.value === does.t}>
      {text}
      {key && " "}
      {key && <kbd>{key}</kbd>}
    </NextStep>
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

const LEAST = 0.05; // Fraction of the robot's limit.
const STEP = 0.05;

/** Speed, and the limit that the operator chooses: one bar for both. */
function Speed() {
  const { drive, link } = useSession();
  const { deck } = texts();
  const [speed, unit] = [speedOf(link), unitOf(link)];
  const robot = link.robot.value;
  const limits = link.state.value?.status.limits;
  const unit_m = robot?.twist_scale_m ?? 1;
  // The bar ends where the robot does; below that it may allow less for now.
  const most = (robot?.max_speed_mps ?? 0) / unit_m || 1;
  const active = (limits?.speed_mps ?? 0) / unit_m || most;
  const limit = drive.scale.value.speed;
  const set = (level: number) => {
    drive.level.value = Math.round(100 * Math.max(LEAST, Math.min(1, level))) / 100;
  };
  const handlers = sliderHandlers(
    (share) => set((share * most) / active),
    (steps) => set(drive.level.peek() + STEP * Math.max(-4, Math.min(4, steps))),
  );
  const percent = (part: number) => `${100 * Math.max(0, Math.min(1, part / most))}%`;
  const why = limits?.why.map((reason) => words(reason)).join("; ") ?? "";
  return (
    <>
      <p class="hero">
        <span class="n">{figure(speed, 2)}</span>
        <span class="u">{unit}</span>
      </p>
      <div
        {...handlers}
        {...sliderValue(LEAST * active, active, limit, `${figure(limit, 2)} ${deck.units[unit]}`)}
        class="cap"
        aria-label={deck.limit}
        title={why === "" ? undefined : deck.slower(why)}
        style={{ "--limit": percent(limit) }}
      >
        <span class="track">
          <i style={{ width: percent(speed ?? 0) }} />
          <em />
        </span>
        <span class="handle" />
        <span class="lab">{deck.limitAt(figure(limit, 2))}</span>
      </div>
    </>
  );
}
