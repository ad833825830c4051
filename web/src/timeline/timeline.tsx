// The line above the deck: the last half minute of the live robot, or the lanes of a recording; and
// the list of recordings, which both open.

import { useSession } from "../session";
import { Live } from "./live";
import { Recorded } from "./recorded";
import { Recordings } from "./recordings";
import "./timeline.css";

export function Timeline() {
  const { library, link } = useSession();
  return (
    <>
      {link.recording === null ? <Live /> : <Recorded />}
      {library.open.value && <Recordings />}
    </>
  );
}
