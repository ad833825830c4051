// Account menu: name and role of the login, and logout.

import { Button } from "./button.js";
import { el, setText } from "./dom.js";
import { known } from "./link.js";
import { notStop, WATCHES, watches } from "./permission.js";

const ASK_MS = 2000;

export class Account {
  /** Marks `frame` for viewers. @param {Link} link @param {HTMLElement} frame */
  constructor(link, frame) {
    this._link = link;
    this._frame = frame;
    this._leaving = false;
    this._user = el("span.user");
    const out = new Button("Log out", () => this._logOut(), { kind: "quiet" });
    this.element = el("span.group.account", { hidden: true }, this._user, out.element);
    this.watching = el("p.watching", { hidden: true });
    link.on("welcome", () => this._draw());
    link.on("down", () => this._ask());
  }

  _draw() {
    const { user } = known(this._link.welcome);
    this.element.hidden = user === null;
    setText(this._user, user ?? "");
    this._frame.toggleAttribute("data-watches", watches(this._link));
    this._frame.toggleAttribute("data-cannot-stop", notStop(this._link) !== null);
    this.watching.hidden = !watches(this._link);
    setText(this.watching, notStop(this._link) ?? WATCHES);
  }

  async _logOut() {
    this._leaving = true;
    await fetch("logout", { method: "POST", redirect: "manual" }).catch(() => undefined);
    location.assign("login");
  }

  /** Browsers do not report why a socket failed; if the login has expired, open the login page. */
  async _ask() {
    if (this._leaving || this._link.connected || (this._link.welcome?.user ?? null) === null)
      return;
    const answer = await fetch("healthz").catch(() => undefined);
    if (answer?.status === 401) location.assign("login");
    else setTimeout(() => this._ask(), ASK_MS);
  }
}
