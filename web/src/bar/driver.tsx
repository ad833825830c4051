// Who drives, and the quiet actions: the next step is in the deck.

import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { type Refusal, whyNot, whyNotTakeControl } from "../store/permission";
import { nameOf, refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Button, type ButtonProps } from "../ui/button";

const AT_REST = new Set(["disarmed", "stopped", "fault"]);

/** Text with a name in it, whose direction of writing stays its own. */
export function Named({ text, name }: { text: (name: string) => string; name: string }) {
  const [before, after] = text("\0").split("\0");
  return (
    <>
      {before}
      <b>
        <bdi title={name}>{name}</bdi>
      </b>
      {after}
    </>
  );
}

/** Who has control of the robot; null if the page cannot know. */
export function useLease() {
  const { link } = useSession();
  const state = link.state.value;
  if (freshness(link).kind !== "live" || state === null) return null;
  const { lease, mode } = state.status;
  const isViewer = link.welcome.value?.role === "viewer";
  return { ...lease, mode, you: state.has_control, isViewer };
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
  const who = holder ?? keptFor;
  const text = holder === null ? bar.kept : bar.drives;
  const isFree = who === null && !isViewer;
  const named = who !== null && !you ? text(nameOf(who)) : null;
  const title = [isViewer && bar.mayLook, you && bar.you, named, isFree && bar.free];
  return (
    <span class="fact driver" title={title.filter(Boolean).join(" ")}>
      {isViewer && <b>{bar.mayLook}</b>}
      {you && <b>{bar.you}</b>}
      {named !== null && who !== null && <Named text={text} name={nameOf(who)} />}
      {isFree && bar.free}
    </span>
  );
}

/** Button that is disabled while a request is pending. */
function Quiet({ refusal, ...button }: ButtonProps & { refusal?: Refusal | null }) {
  const isPending = useSession().requests.pending.value !== null;
  const refused = isPending ? texts().bar.underWay : refusal && refusalText(refusal);
  return <Button {...button} refused={refused} />;
}

export function Actions() {
  const { layout, link, requests } = useSession();
  const { bar } = texts();
  const lease = useLease();
  if (lease === null || lease.isViewer) return null;
  const { you, holder, mode, requested_by: asker } = lease;
  const takeOver = () => (layout.dialog.value = "takeover");
  const release = () => requests.send({ t: "lease", op: "release" });
  const isMine = you && asker === null; // A question takes their place.
  return (
    <>
      {!you && holder !== null && (
        <Quiet refusal={whyNotTakeControl(link)} onPress={takeOver}>
          {bar.takeOver}
        </Quiet>
      )}
      {isMine && !AT_REST.has(mode) && (
        <Quiet refusal={whyNot(link, "disarm")} onPress={() => requests.send({ t: "disarm" })}>
          {bar.disarm}
        </Quiet>
      )}
      {isMine && <Quiet onPress={release}>{bar.release}</Quiet>}
    </>
  );
}

/**
 * A request for control, for who is asked. The deck has its answers; the bar has them while a held
 * path keeps the deck. It never takes the focus.
 */
export function Question() {
  const { requests, path } = useSession();
  const { bar } = texts();
  const lease = useLease();
  const requester = lease?.you ? lease.requested_by : null;
  const name = nameOf(requester ?? "");
  const asks = requester === null ? "" : `${bar.asksYou(name)} ${bar.youDriveOn}`;
  const answer = (op: "grant" | "deny") =>
    requester !== null && requests.send({ t: "lease", op, requester });
  return (
    <>
      <span class="sr" role="alert">
        {asks || null}
      </span>
      {requester !== null && path.going.value && (
        <div class="asks" role="group" aria-label={bar.request}>
          <span title={bar.asksYou(name)}>
            <Named text={bar.asksYou} name={name} />
            <span class="u" aria-hidden="true">
              {Math.ceil(lease?.request_expires_in_s ?? 0)} s
            </span>
          </span>
          <Quiet edge onPress={() => answer("grant")}>
            {bar.answers.grant}
          </Quiet>
          <Quiet onPress={() => answer("deny")}>{bar.answers.deny}</Quiet>
        </div>
      )}
    </>
  );
}
