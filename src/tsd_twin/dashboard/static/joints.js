// The tab of the actuators: what there is to see of them is up to the robot.

import { el } from "./dom.js";
import { Gimbals } from "./gimbals.js";
import { Sphere } from "./sphere.js";
import { Wheels } from "./wheels.js";

const PANELS = { gimbals: Gimbals, wheels: Wheels, sphere: Sphere };

export class Joints {
  constructor(link, place, bringUp) {
    this._link = link;
    this._bringUp = bringUp;
    this._place = el("div");
    place.append(this._place);
    this._open = true;
    link.on("robot", () => this._open && this._choose());
    this._choose();
  }

  close() {
    this._open = false;
    this._content?.close();
  }

  _choose() {
    const kind = this._link.robot?.panel ?? "gimbals";
    if (kind === this._kind) return;
    this._kind = kind;
    this._content?.close();
    this._place.replaceChildren();
    this._content = new PANELS[kind](this._link, this._place, this._bringUp);
  }
}
