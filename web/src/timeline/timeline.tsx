// The line above the deck: the last half minute of the live robot, or the lanes of a recording; and
// the list of recordings, which both open.

import { useSession } from "../session";
import type { Link } from "../store/link";
import { Library, recordingsOpen } from "./library";
import { Live } from "./live";
import { LookBack } from "./look_back";
import { Recorded } from "./recorded";
import { Recordings } from "./recordings";
import "./timeline.css";

/** Kept while the fleet screen is open. */
const kept = new WeakMap<Link, { library: Library; back: LookBack }>();

export function Timeline() {
  const { link } = useSession();
  const { library, back } = kept.get(link) ?? {
    library: new Library(link),
    back: new LookBack(link),
  };
  kept.set(link, { library, back });
  return (
    <>
      {link.recording === null ? <Live back={back} library={library} /> : <Recorded />}
      {recordingsOpen.value && <Recordings library={library} />}
    </>
  );
}
