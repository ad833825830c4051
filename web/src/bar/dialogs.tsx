// Dialogs of the bar: keys and settings, the operator's name, and control taken from another.

import { useEffect, useRef } from "preact/hooks";
import { useSession } from "../session";
import type { Link } from "../store/link";
import { controlTerms } from "../store/requests";
import { nameOf } from "../text/reasons";
import { LANGUAGES, language, texts } from "../text/text";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";
import { Segmented } from "../ui/segmented";
import type { Opened } from "./bar";
import { Actions, Named, useLease, Who } from "./driver";
import { FleetLink } from "./facts";

const LANGUAGE_NAMES = { en: "English", de: "Deutsch" };
const THEMES = ["system", "dark", "light"] as const;
const ASK_MS = 2000;

interface OpenedProps {
  opened: Opened;
}

/** Keys and settings; in a narrow window also what the bar has no room for. */
export function Sheet({ opened }: OpenedProps) {
  const { gamepad, layout, view } = useSession();
  const { bar } = texts();
  const { dark } = view.settings.value;
  const close = () => (opened.value = null);
  // Lines "key: what it does".
  const keys = gamepad.name.value === null ? bar.keyList : [...bar.padKeys, ...bar.keyList];
  return (
    <Dialog title={bar.help} onClose={close}>
      {layout.phone.value && layout.screen.value === "robot" && (
        <div class="row">
          <Who />
          <Actions opened={opened} />
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
        <Button edge onPress={() => (opened.value = "name")}>
          <OwnName />
        </Button>
        <Segmented
          label={bar.theme}
          value={dark === null ? "system" : dark ? "dark" : "light"}
          choices={THEMES.map((value) => ({ value, text: bar.themes[value] }))}
          onChoose={(theme) => view.set({ dark: theme === "system" ? null : theme === "dark" })}
        />
        <Segmented
          label={bar.language}
          value={language.value}
          choices={LANGUAGES.map((value) => ({ value, text: LANGUAGE_NAMES[value] }))}
          onChoose={(chosen) => (language.value = chosen)}
        />
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

/** The operator's name, typed or of the login. */
export function NameDialog({ opened }: OpenedProps) {
  const session = useSession();
  const { bar } = texts();
  const user = session.link.welcome.value?.user ?? null;
  const close = () => (opened.value = null);
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
export function TakeOver({ opened }: OpenedProps) {
  const { link, requests } = useSession();
  const { bar } = texts();
  const holder = useLease()?.holder ?? null;
  const before = useRef(holder);
  const isOver = holder === null || holder !== before.current;
  const close = () => (opened.value = null);
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

interface LineFormProps {
  label: string;
  initial?: string;
  /** Longest text in characters. */
  most: number;
  action: string;
  onSend: (text: string) => void;
  onClose: () => void;
}

function LineForm({ label, initial, most, action, onSend, onClose }: LineFormProps) {
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const text = new FormData(event.currentTarget as HTMLFormElement).get("text");
    onSend(String(text).trim());
    onClose();
  };
  return (
    <form onSubmit={submit}>
      <label>
        {label}
        <span class="field">
          <input name="text" dir="auto" maxLength={most} defaultValue={initial} />
        </span>
      </label>
      <p class="note">{texts().bar.spaceTypes}</p>
      <Button edge submit children={action} />
    </form>
  );
}
