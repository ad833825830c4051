// The operator's name, typed or of the login.

import { useEffect } from "preact/hooks";
import { useSession } from "../session";
import type { Link } from "../store/link";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";
import { Named } from "./driver";
import { TextDialog } from "./text_dialog";

const ASK_MS = 2000;

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

async function logOut(): Promise<void> {
  await fetch("logout", { method: "POST", redirect: "manual" }).catch(() => undefined);
  location.assign("login");
}

export function OwnName() {
  const { link, name } = useSession();
  const { yourName } = texts().bar;
  const own = link.welcome.value?.user || name.value;
  if (own === "") return <>{yourName}</>;
  return (
    <>
      <span class="sr">{yourName}: </span>
      <bdi>{own}</bdi>
    </>
  );
}

export function NameDialog({ onClose }: { onClose: () => void }) {
  const session = useSession();
  const { bar } = texts();
  const user = session.link.welcome.value?.user ?? null;
  if (user === null)
    return (
      <TextDialog
        title={bar.yourName}
        label={bar.yourName}
        initial={session.name.peek()}
        most={40}
        action={bar.save}
        onSubmit={(name) => session.rename(name)}
        onClose={onClose}
      >
        {bar.nameHint}
      </TextDialog>
    );
  return (
    <Dialog title={bar.yourName} onClose={onClose}>
      <p>
        <Named text={bar.loggedIn} name={user} />
      </p>
      <Button edge onPress={() => void logOut()}>
        {bar.logOut}
      </Button>
    </Dialog>
  );
}
