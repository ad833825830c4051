// The page: STOP is first in tab order, so the deck comes first in the document.

import { useEffect } from "preact/hooks";
import { Bar } from "../bar/bar";
import { Deck } from "../deck/deck";
import { Fleet } from "../fleet/fleet";
import { Panel } from "../panel/panel";
import { Scene } from "../scene/scene";
import { type Session, SessionContext } from "../session";
import { language, texts } from "../text/text";
import { Live } from "../timeline/live";
import { Recorded } from "../timeline/recorded";
import { Recordings } from "../timeline/recordings";
import "../timeline/timeline.css";
import "./shell.css";

export function App({ session }: { session: Session }) {
  const { layout, library, link } = session;
  const robot = link.robot.value;
  const { common } = texts();
  const isFleet = layout.screen.value === "fleet";
  useEffect(() => {
    document.documentElement.lang = language.value;
    document.title = isFleet ? common.fleet : robot ? common.title(robot.title) : "tsd-twin";
  });
  const classes = [
    "app",
    isFleet ? "fleet" : layout.panelOpen.value ? layout.panelWidth.value : "folded",
    link.recording !== null && "past",
  ];
  return (
    <SessionContext.Provider value={session}>
      <h1 class="sr">{robot ? common.title(robot.title) : "tsd-twin"}</h1>
      <div class={classes.filter(Boolean).join(" ")}>
        <Deck />
        <Bar />
        <Scene />
        {isFleet ? (
          <Fleet />
        ) : (
          <>
            <Panel />
            {link.recording === null ? <Live /> : <Recorded />}
            {library.open.value && <Recordings />}
          </>
        )}
      </div>
    </SessionContext.Provider>
  );
}
