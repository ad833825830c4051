// Hand-over of control: notices for the holder and the requester. The notice never
// takes the focus; it is announced once, and its buttons are in the order of the page.

import { Button } from "./button.js";
import { el, icon, setAttribute, setText } from "./dom.js";

const REASON = "urgent";

export class HandOver {
  /**
   * @param {Link} link
   * @param {Tooltip} tips
   * @param {Notices} notices
   * @param {{ acquire: (reason: string) => void, wish: () => { max_age_s: number | null } }} control
   */
  constructor(link, tips, notices, { acquire, wish }) {
    this._link = link;
    this._notices = notices;
    this._acquire = acquire;
    this._wish = wish;
    this._asking = false;
    /** @type {string | null} */
    this._asker = null;
    this._said = el("div", { class: "sr", role: "alert" });
    this._text = el("strong");
    this._then = el("span", { class: "then" });
    this._count = el("span", { class: "number", "aria-hidden": "true" });
    /** @type {(label: string, tip: string, kind: string, press: () => void) => Button} */
    const button = (label, tip, kind, press) => new Button(label, { tips, press, kind, tip });
    this._grant = button(
      "Hand over",
      "The robot comes to rest, then they have control",
      "primary",
      () => this._send("grant", { asker: this._asker }),
    );
    this._keep = button("Keep control", "Tell them that you drive on", "", () =>
      this._send("deny", { asker: this._asker }),
    );
    this._withdraw = button("Withdraw", "Ask for control no longer", "", () =>
      this._send("withdraw"),
    );
    this._force = button("Take over…", "Take control without waiting, and say why", "quiet", () =>
      this.takeOver(),
    );
    this._buttons = [this._force, this._withdraw, this._keep, this._grant];
    this._card = el(
      "div",
      {
        class: "handover surface",
        role: "group",
        "aria-label": "Request for control",
        hidden: true,
      },
      icon("ask"),
      el("div", { class: "what" }, this._text, this._then),
      this._count,
      el("div", { class: "row" }, ...this._buttons.map(({ element }) => element)),
    );
    this.element = el("div", {}, this._said, this._card);
    for (const type of /** @type {const} */ (["state", "beat", "down"]))
      link.on(type, () => this._draw());
    link.on("reply", (reply) => this._checkReply(reply));
  }

  /** Whether this page has asked and waits for the answer. */
  get waits() {
    const asker = this._link.state?.status.lease.asked_by ?? null;
    return asker !== null && asker === this._link.welcome?.operator;
  }

  /** Ask the holder for control. */
  ask() {
    this._asking = true;
    this._send("request", this._wish());
  }

  withdraw() {
    this._send("withdraw");
  }

  /** Take control over, after a question; `why` tells why asking did not do. */
  takeOver(why = "") {
    const holder = this._link.state?.status.lease.holder ?? null;
    if (holder === null) return;
    this._notices.ask(
      `${why}${holder} drives now and would lose control. The robot comes to rest.`,
      "Take over",
      (reason) => this._acquire(reason || REASON),
      { label: "Reason, for all to see", value: REASON },
    );
  }

  /** @param {LeaseAction["op"]} op */
  _send(op, more = {}) {
    this._link.send({ t: "lease", op, ...more });
  }

  /** @param {ActionReply} reply */
  _checkReply({ to, ok, reason }) {
    if (to !== "lease" || !this._asking) return;
    this._asking = false;
    if (!ok) this.takeOver(`You cannot ask now: ${reason}. `);
  }

  _draw() {
    const { state } = this._link;
    const lease = state?.status.lease ?? null;
    const asked = this._link.connected && (lease?.asked_by ?? null) !== null;
    const holds = asked && state?.you === true;
    const shown = holds || (asked && this.waits);
    this._card.hidden = !shown;
    this._asker = lease?.asked_by ?? null;
    if (!shown || lease === null) {
      setText(this._said, "");
      return;
    }
    setAttribute(this._card, "data-role", holds ? "holder" : "asker");
    for (const { element } of [this._keep, this._grant]) element.hidden = !holds;
    for (const { element } of [this._force, this._withdraw]) element.hidden = holds;
    setText(
      this._text,
      holds ? `${lease.asked_by} asks for control.` : `You have asked ${lease.holder} for control.`,
    );
    setText(this._then, holds ? "You drive on until you hand over." : "Waiting for the answer.");
    setText(this._count, `${Math.ceil(lease.asks_for_s)} s`);
    setText(this._said, `${this._text.textContent} ${this._then.textContent}`);
  }
}
