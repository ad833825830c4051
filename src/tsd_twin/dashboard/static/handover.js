// Control of the robot: acquiring, requesting and transferring it. The notice for holder and
// requester never takes focus and is announced once; its buttons follow the page order.

import { Button } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";
import { nameOf, words } from "./reasons.js";

const NO_REASON = "no reason given";
const FAR_MS = 120; // Above this round trip, commands often exceed the default age limit.

export class HandOver {
  /** @param {Link} link @param {Notices} notices */
  constructor(link, notices) {
    this._link = link;
    this._notices = notices;
    this._asking = false;
    this._asker = null;
    this._askedFrom = null; // Holder addressed by the open question.
    this._said = el("div.sr", { role: "alert" });
    this._text = el("strong");
    this._then = el("span.then");
    this._count = el("span.number", { "aria-hidden": "true" });
    this._grant = new Button("Hand over", () => this._send("grant", { requester: this._asker }), {
      tip: "The robot comes to rest first",
      kind: "primary",
    });
    this._keep = new Button("Keep control", () => this._send("deny", { requester: this._asker }), {
      tip: "You drive on",
    });
    this._withdraw = new Button("Withdraw", () => this.withdraw(), {
      tip: "Ask for control no longer",
    });
    this._force = new Button("Take over…", () => this.takeOver(), {
      tip: "Take control without waiting; say why",
      kind: "quiet",
    });
    this._buttons = [this._force, this._withdraw, this._keep, this._grant];
    this._card = el(
      "div.handover.surface",
      { role: "group", "aria-label": "Request for control", hidden: true },
      icon("ask"),
      el("div.what", this._text, this._then),
      this._count,
      el("div.row", ...this._buttons.map(({ element }) => element)),
    );
    this.element = el("div", this._said, this._card);
    link.on(["state", "beat", "down"], () => this._draw());
    link.on("reply", ({ to, ok, why }) => {
      if (to !== "lease" || !this._asking) return;
      this._asking = false;
      if (!ok) this.takeOver(`You cannot ask now: ${why ? words(why) : "it was refused"}. `);
    });
    link.on("down", () => (this._asking = false));
  }

  /** Whether a question or request on this page is pending. */
  get isOpen() {
    return !this._card.hidden || this._notices.asks;
  }

  /** Whether this page has requested control and waits for a response. */
  get waits() {
    const asker = this._link.state?.status.lease.requested_by ?? null;
    return asker !== null && asker === this._link.welcome?.operator;
  }

  /** Request control from the holder. */
  ask() {
    this._asking = true;
    this._send("request", this._terms());
  }

  /** Acquire control; with a reason, also from its holder. @param {string | null} reason */
  acquire(reason = null) {
    const over = reason === null ? {} : { take_over: true, reason };
    this._send("acquire", { ...this._terms(), ...over });
  }

  release() {
    this._send("release");
  }

  withdraw() {
    this._send("withdraw");
  }

  /** Take control over after confirmation; `why` explains why a request is not enough. */
  takeOver(why = "") {
    const holder = this._link.state?.status.lease.holder ?? null;
    if (holder === null) return;
    this._notices.ask(
      `${why}${nameOf(holder)} drives and loses control. The robot comes to rest.`,
      "Take over",
      "Reason, for all to see (you may leave it empty)",
      (reason) => this.acquire(reason || NO_REASON),
    );
    this._askedFrom = holder;
  }

  /** A slow link gets a higher age limit, and a lower speed limit set by the robot. */
  _terms() {
    const trip = this._link.roundTripMs() ?? 0;
    return { max_age_s: trip > FAR_MS ? (2 * trip + 100) / 1000 : null };
  }

  /** @param {LeaseAction["op"]} op */
  _send(op, more = {}) {
    this._link.send({ t: "lease", op, ...more });
  }

  _draw() {
    const { state } = this._link;
    const lease = state?.status.lease ?? null;
    if (this._askedFrom !== null && lease?.holder !== this._askedFrom) {
      this._askedFrom = null; // The holder has changed, so ask again.
      this._notices.dismissPrompt();
    }
    const asked = this._link.connected && (lease?.requested_by ?? null) !== null;
    const holds = asked && state?.has_control === true;
    this._card.hidden = !(holds || (asked && this.waits));
    const asker = lease?.requested_by ?? "";
    this._asker = asker || null;
    if (this._card.hidden || lease === null) {
      setText(this._said, "");
      return;
    }
    setAttribute(this._card, "data-role", holds ? "holder" : "asker");
    for (const { element } of [this._keep, this._grant]) element.hidden = !holds;
    for (const { element } of [this._force, this._withdraw]) element.hidden = holds;
    setText(
      this._text,
      holds
        ? `${nameOf(asker)} asks for control.`
        : `You have asked ${nameOf(lease.holder ?? "")} for control.`,
    );
    setText(this._then, holds ? "You drive on until you hand over." : "Waiting for the answer.");
    setText(this._count, `${Math.ceil(lease.request_expires_in_s)} s`);
    setText(this._said, `${this._text.textContent} ${this._then.textContent}`);
  }
}
