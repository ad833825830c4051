// STOP: acts when it is touched, in every state; the line below reports the result.

import { useId, useRef } from "preact/hooks";
import { type Session, useSession } from "../session";
import { freshness } from "../store/freshness";
import { isLatched, whyNotStop } from "../store/permission";
import { refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Icon } from "../ui/icon";

export function StopCell() {
  const session = useSession();
  const { link, stop, layout } = session;
  const { deck } = texts();
  const hint = useId();
  const touched = useRef(false);
  const said = hintOf(session);
  const isHollow = isLatched(link) && freshness(link).kind === "live";
  // Where fingers drive there are no keys to name, and the button itself has room for the rest.
  const isTouch = layout.phone.value || layout.sideways.value;
  const line = (
    <span id={hint} class="hint">
      {said ?? (
        <>
          <kbd>{deck.stop.space}</kbd> {deck.stop.gamepad} <kbd>B</kbd>
        </>
      )}
    </span>
  );
  // A click would wait for the finger to come up, and a second finger would not click at all.
  const down = (event: PointerEvent) => {
    event.preventDefault();
    touched.current = true;
    stop.press();
  };
  // Keys and assistive technology click without a pointer.
  const click = ({ detail }: MouseEvent) => {
    if (detail === 0 || !touched.current) stop.press();
    touched.current = false;
  };
  const forget = () => (touched.current = false);
  return (
    <div class="stopcell mid">
      <button
        type="button"
        class={isHollow ? "stop latched" : "stop"}
        aria-describedby={hint}
        aria-disabled={whyNotStop(link) !== null || undefined}
        title={deck.stop.help}
        onPointerDown={down}
        onPointerLeave={forget}
        onPointerCancel={forget}
        onClick={click}
        onContextMenu={(event) => event.preventDefault()}
      >
        <Icon name="stopsign" />
        <span>STOP</span>
        {isTouch && said && line}
      </button>
      {!isTouch && line}
    </div>
  );
}

/** What must be known about STOP now, or null: then its keys can be named. */
function hintOf({ link, stop }: Session): string | null {
  const { stop: words } = texts().deck;
  const refusal = whyNotStop(link);
  if (refusal !== null) return refusalText(refusal);
  if (stop.unconfirmed.value) return words.unconfirmed;
  const { kind } = freshness(link);
  if (kind === "starting") return link.connected.value ? null : words.noLinkYet;
  if (kind === "offline") return words.noLink;
  if (kind === "silent" || kind === "recorded") return words[kind];
  return isLatched(link) ? words.latched : null;
}
