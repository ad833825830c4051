// Who drives, and the quiet actions: the next step is in the deck.

import { useEffect, useRef } from "preact/hooks";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { type Refusal, whyNotDisarm, whyNotTakeControl } from "../store/permission";
import { controlTerms } from "../store/requests";
import { nameOf, refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import type { Opened } from "./bar";
import { TextDialog } from "./text_dialog";

const AT_REST = new Set(["disarmed", "stopped", "fault"]);

/** Text with a name in it, whose direction of writing stays its own. */
export function Named({ text, name }: { text: (name: string) => string; name: string }) {
  const [before, after] = text("\0").split("\0");
  return (
    <>
      {before}
      <b>
        <bdi>{name}</bdi>
      </b>
      {after}
    </>
  );
}

/** Who has control of the robot; null if the page cannot know. */
function useLease() {
  const { link } = useSession();
  void link.beat.value; // A robot falls silent without a message.
  const state = link.state.value;
  if (freshness(link).kind !== "live" || state === null) return null;
  const { lease, mode } = state.status;
  const { role } = link.welcome.value ?? {};
  return { ...lease, mode, you: state.has_control, isViewer: role === "viewer" };
}

export function Who() {
  const { link } = useSession();
  const { bar } = texts();
  const lease = useLease();
  if (lease === null) {
    const isReplay = link.recording === null && isCurrent(freshness(link));
    return isReplay ? <span class="fact">{bar.replayShown}</span> : null;
  }
  const { holder, reserved_for: keptFor, you, isViewer } = lease;
  return (
    <span class="fact driver">
      {isViewer && <b>{bar.mayLook}</b>}
      {you && <b>{bar.you}</b>}
      {!you && holder !== null && <Named text={bar.drives} name={nameOf(holder)} />}
      {holder === null && keptFor !== null && <Named text={bar.kept} name={nameOf(keptFor)} />}
      {holder === null && keptFor === null && !isViewer && bar.free}
    </span>
  );
}

export function Actions({ opened }: { opened: Opened }) {
  const { link, requests } = useSession();
  const { bar } = texts();
  const lease = useLease();
  const refused = useRefused();
  if (lease === null || lease.isViewer || (!lease.you && lease.holder === null)) return null;
  if (lease.you && lease.requested_by !== null) return null; // The question takes their place.
  if (!lease.you)
    return (
      <Button
        refused={refused(whyNotTakeControl(link))}
        onPress={() => (opened.value = "take over")}
      >
        {bar.takeOver}
      </Button>
    );
  return (
    <>
      {!AT_REST.has(lease.mode) && (
        <Button
          refused={refused(whyNotDisarm(link))}
          onPress={() => requests.send({ t: "disarm" })}
        >
          {bar.disarm}
        </Button>
      )}
      <Button refused={refused(null)} onPress={() => requests.send({ t: "lease", op: "release" })}>
        {bar.release}
      </Button>
    </>
  );
}

/** Function that words a refusal, or says that a request is under way. */
function useRefused(): (refusal: Refusal | null) => string | null {
  const isPending = useSession().requests.pending.value !== null;
  return (refusal) => (isPending ? texts().bar.underWay : refusal && refusalText(refusal));
}

/**
 * A request for control, for who is asked. The deck has its answers; the bar has them while a held
 * path keeps the deck. It never takes the focus.
 */
export function Question() {
  const { requests, path } = useSession();
  const { bar } = texts();
  const lease = useLease();
  const refused = useRefused()(null);
  const requester = lease?.you ? lease.requested_by : null;
  if (requester === null) return <span class="sr" role="alert" />;
  const name = nameOf(requester);
  return (
    <>
      <span class="sr" role="alert">
        {`${bar.asksYou(name)} ${bar.youDriveOn}`}
      </span>
      {path.going.value && (
        <div class="asks" role="group" aria-label={bar.request}>
          <span>
            <Named text={bar.asksYou} name={name} />
            <span class="u" aria-hidden="true">
              {Math.ceil(lease?.request_expires_in_s ?? 0)} s
            </span>
          </span>
          {(["grant", "deny"] as const).map((op) => (
            <Button
              key={op}
              edge={op === "grant"}
              refused={refused}
              onPress={() => requests.send({ t: "lease", op, requester })}
            >
              {bar.answers[op]}
            </Button>
          ))}
        </div>
      )}
    </>
  );
}

/** Confirm that another operator loses control, and say why; it closes once the holder changes. */
export function TakeOver({ onClose }: { onClose: () => void }) {
  const { link, requests } = useSession();
  const { bar } = texts();
  const holder = useLease()?.holder ?? null;
  const before = useRef(holder);
  const isOver = holder === null || holder !== before.current;
  useEffect(() => {
    if (isOver) onClose();
  }, [isOver]);
  if (isOver) return null;
  const takeOver = (reason: string) => {
    const why = reason === "" ? {} : { reason };
    requests.send({ t: "lease", op: "acquire", take_over: true, ...why, ...controlTerms(link) });
  };
  return (
    <TextDialog
      title={bar.takeOver}
      label={bar.reason}
      most={120}
      action={bar.takeOver}
      onSubmit={takeOver}
      onClose={onClose}
    >
      <Named text={bar.loses} name={nameOf(holder)} />
    </TextDialog>
  );
}
