// What all parts of the page share: the link, the one command, STOP, and the page's own settings.

import { effect, untracked } from "@preact/signals";
import { createContext } from "preact";
import { useContext } from "preact/hooks";
import { Drive } from "./drive/drive";
import { Gamepad } from "./drive/gamepad";
import { Keyboard } from "./drive/keyboard";
import { Path } from "./drive/path";
import { SphereTurn } from "./drive/sphere";
import { Stop } from "./drive/stop";
import { FleetStore } from "./fleet/store";
import { Recorder } from "./plots/recorder";
import { PictureFeed } from "./scene/picture_feed";
import { Layout } from "./store/layout";
import { Link } from "./store/link";
import { isText, remembered } from "./store/memory";
import { News, Notice } from "./store/news";
import { whyNotDrive } from "./store/permission";
import { Requests } from "./store/requests";
import { View } from "./store/view";
import { StudentModel } from "./student/model";
import { Library } from "./timeline/library";
import { LookBack } from "./timeline/look_back";
import { Playback } from "./timeline/playback";

function newPageId(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(8));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export class Session {
  readonly name = remembered("tsd-name", "", isText);
  readonly layout = new Layout();
  readonly link = new Link(
    newPageId(),
    new URL(location.href).searchParams.get("recording"),
    this.name.peek(),
  );
  /** A page that shows a recording tells what the robot itself does now. */
  readonly fleet = new FleetStore(
    this.link,
    () => this.layout.screen.value === "fleet" || this.link.recording !== null,
  );
  /** Nobody drives a robot that the page does not show, or by a picture that is old. */
  readonly drive: Drive = new Drive(this.link, () => {
    if (this.layout.screen.value === "fleet") return { by: "page", code: "fleet_shown" };
    if (this.drive.caution.value === 0) return { by: "page", code: "picture_old" };
    return whyNotDrive(this.link);
  });
  readonly pictures = new PictureFeed(this.link, this.drive, this.layout.narrow.peek());
  readonly stop = new Stop(this.link, () => this.drive.release());
  readonly keyboard = new Keyboard(this.drive, () => this.#pressRed());
  readonly gamepad = new Gamepad(this.drive, () => this.#pressRed());
  readonly path = new Path(this.link, this.drive, this.keyboard);
  readonly sphere = new SphereTurn(this.link, this.drive);
  readonly notice = new Notice(this.link);
  readonly requests = new Requests(this.link);
  readonly view = new View(this.link);
  readonly recorder = new Recorder(this.link);
  readonly student = new StudentModel(this.link, location.search);
  readonly library = new Library(this.link);
  readonly lookBack = new LookBack(this.link);
  readonly playback = new Playback(this.link);

  constructor() {
    new News(this);
    effect(() => {
      if (this.layout.screen.value === "fleet") untracked(() => this.drive.release());
    });
  }

  /** Press the red button of the page: STOP, or STOP ALL on the page of all robots. */
  #pressRed(): void {
    if (this.layout.screen.peek() === "fleet") this.fleet.stopAll();
    else this.stop.press();
  }

  rename(name: string): void {
    this.name.value = [...name.normalize("NFC")].slice(0, 40).join("");
    this.link.rename(this.name.peek());
  }
}

export const SessionContext = createContext<Session | null>(null);

export function useSession(): Session {
  const session = useContext(SessionContext);
  if (session === null) throw new Error("no session around this component");
  return session;
}
