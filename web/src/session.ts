// What all parts of the page share: the link, the one command, STOP, and the page's own settings.

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
import { Layout } from "./store/layout";
import { Link } from "./store/link";
import { isText, remembered } from "./store/memory";
import { News } from "./store/news";
import { Notice } from "./store/notice";
import { Requests } from "./store/requests";
import { View } from "./store/view";
import { StudentModel } from "./student/model";
import { Library } from "./timeline/library";
import { LookBack } from "./timeline/look_back";
import { Playback } from "./timeline/playback";

export class Session {
  readonly name = remembered("tsd-name", "", isText);
  readonly link: Link;
  readonly drive: Drive;
  readonly stop: Stop;
  readonly keyboard: Keyboard;
  readonly gamepad: Gamepad;
  readonly path: Path;
  readonly sphere: SphereTurn;
  readonly notice: Notice;
  readonly requests: Requests;
  readonly view: View;
  readonly recorder: Recorder;
  readonly layout = new Layout();
  readonly fleet: FleetStore;
  readonly student: StudentModel;
  readonly library: Library;
  readonly lookBack: LookBack;
  readonly playback: Playback;

  constructor() {
    const recording = new URL(location.href).searchParams.get("recording");
    const bytes = crypto.getRandomValues(new Uint8Array(8));
    const page = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
    const hasFocus = () => document.hasFocus();
    this.link = new Link({ page, recording, name: this.name.peek(), hasFocus });
    this.drive = new Drive(this.link);
    this.stop = new Stop(this.link, () => this.drive.release());
    const changed = () => this.drive.changed();
    this.fleet = new FleetStore(this.link, () => this.layout.screen.value === "fleet");
    // The space bar presses the red button of the page: STOP, or STOP ALL on the page of all robots.
    const press = () => {
      if (this.layout.screen.peek() === "fleet") this.fleet.stopAll();
      else this.stop.press();
    };
    this.keyboard = new Keyboard(changed, press);
    this.gamepad = new Gamepad(changed, press);
    this.drive.add(this.keyboard);
    this.drive.add(this.gamepad);
    this.path = new Path(this.link, this.drive, this.keyboard);
    this.sphere = new SphereTurn(this.link, this.drive);
    this.notice = new Notice(this.link);
    this.requests = new Requests(this.link);
    new News(this);
    this.view = new View(this.link);
    this.recorder = new Recorder(this.link);
    this.student = new StudentModel(this.link, location.search);
    this.library = new Library(this.link);
    this.lookBack = new LookBack(this.link);
    this.playback = new Playback(this.link);
  }

  /** Change the display name of the operator. */
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
