// Dialogs of the bar: keys and settings, the operator's name, and control taken from another.

import { useEffect, useRef } from "preact/hooks";
import { LanguageChoice, ThemeChoice } from "../panel/view_tab";
import { useSession } from "../session";
import type { Link } from "../store/link";
import { controlTerms } from "../store/requests";
import { nameOf } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";
import { LineForm } from "../ui/line_form";
import { Actions, Named, useLease, Who } from "./driver";
import { FleetLink } from "./facts";

const ASK_MS = 2000;

/** Keys and settings; in a narrow window also what the bar has no room for. */
export function Sheet() {
  const { gamepad, layout } = useSession();
  const { bar } = texts();
  const close = () => (layout.dialog.value = null);
  // Lines "key: what it does".
  const keys = gamepad.name.value === null ? bar.keyList : [...bar.padKeys, ...bar.keyList];
  return (
    <Dialog title={bar.help} onClose={close}>
      {layout.phone.value && layout.screen.value === "robot" && (
        <div class="row">
          <Who />
          <Actions />
          <FleetLink onClick={close} />
        </div>
      )}
      <dl class="keys">
        {keys.map((line) => {
          const [key, what] = line.split(": ");
          const name = <kbd>{key}</kbd>;
          return [<dt>{name}</dt>, <dd>{what}</dd>];
        })}
      </dl>
      <div class="row">
        <Button edge onPress={() => (layout.dialog.value = "name")}>
          <OwnName />
        </Button>
        <ThemeChoice />
        <LanguageChoice />
      </div>
    </Dialog>
  );
}

export function OwnName() {
  const { link, name } = useSession();
  const { yourName } = texts().bar;
  const { name: shown, user } = link.welcome.value ?? {};
  const own = shown || user || name.value;
  return (
    <>
      {own ? <span class="sr">{yourName}: </span> : yourName}
      {own && <bdi>{own}</bdi>}
    </>
  );
}

export function NameDialog() {
  const session = useSession();
  const { bar } = texts();
  const user = session.link.welcome.value?.user ?? null;
  const close = () => (session.layout.dialog.value = null);
  return (
    <Dialog title={bar.yourName} onClose={close}>
      <p>{user === null ? bar.nameHint : <Named text={bar.loggedIn} name={user} />}</p>
      {user === null ? (
        <LineForm
          label={bar.yourName}
          initial={session.name.peek()}
          most={40}
          action={bar.save}
          onSend={(name) => session.rename(name)}
          onClose={close}
        />
      ) : (
        <Button edge onPress={() => void logOut()} children={bar.logOut} />
      )}
    </Dialog>
  );
}

async function logOut(): Promise<void> {
  await fetch("logout", { method: "POST", redirect: "manual" }).catch(() => undefined);
  location.assign("login");
}

/** Open the login page once the login has expired; browsers do not say why a socket failed. */
export function useLogin(link: Link): void {
  const isLost = !link.connected.value && (link.welcome.value?.user ?? null) !== null;
  useEffect(() => {
    if (!isLost) return undefined;
    const ask = async () => {
      const answer = await fetch("healthz").catch(() => undefined);
      if (answer?.status === 401) location.assign("login");
    };
    const timer = setInterval(ask, ASK_MS);
    return () => clearInterval(timer);
  }, [isLost]);
}

/** Confirm that another operator loses control, and say why; it closes once the holder changes. */
export function TakeOver() {
  const { layout, link, requests } = useSession();
  const { bar } = texts();
  const holder = useLease()?.holder ?? null;
  const before = useRef(holder);
  const isOver = holder === null || holder !== before.current;
  const close = () => (layout.dialog.value = null);
  useEffect(() => {
    if (isOver) close();
  }, [isOver]);
  if (isOver) return null;
  const take = (reason: string) => {
    const why = reason === "" ? {} : { reason };
    requests.send({ t: "lease", op: "acquire", take_over: true, ...why, ...controlTerms(link) });
  };
  return (
    <Dialog title={bar.takeOver} onClose={close}>
      <p>
        <Named text={bar.loses} name={nameOf(holder)} />
      </p>
      <LineForm label={bar.reason} most={120} action={bar.takeOver} onSend={take} onClose={close} />
    </Dialog>
  );
}
