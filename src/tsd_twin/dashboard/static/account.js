// Account menu: name and role of the login, and logout.

import { Button } from "./button.js";
import { el, setText } from "./dom.js";
import { assertDefined } from "./link.js";
import { stopBlockedReason, READ_ONLY, isReadOnly } from "./blocked_reasons.js";

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
    const { user } = assertDefined(this._link.welcome);
    this.element.hidden = user === null;
    setText(this._user, user ?? "");
    this._frame.toggleAttribute("data-watches", isReadOnly(this._link));
    this._frame.toggleAttribute("data-cannot-stop", stopBlockedReason(this._link) !== null);
    this.watching.hidden = !isReadOnly(this._link);
    setText(this.watching, stopBlockedReason(this._link) ?? READ_ONLY);
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
