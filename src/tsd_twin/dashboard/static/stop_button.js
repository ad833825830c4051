// STOP: the one control that works in every state, for everybody.

import { el, icon, setAttribute } from "./dom.js";

export class StopButton {
  /** @param {Link} link @param {Tooltip} tips @param {() => void} stop */
  constructor(link, tips, stop) {
    this.button = el(
      "button",
      {
        type: "button",
        class: "stop",
        "aria-label": "STOP",
        "aria-describedby": "stop-help",
        // Not click: that never comes from a second finger while the first holds the stick.
        onpointerdown: (event) => {
          event.preventDefault();
          stop();
        },
        onclick: stop,
        oncontextmenu: (event) => event.preventDefault(),
      },
      icon("stopped"),
      el("span", { class: "label" }, "STOP"),
    );
    this.element = el(
      "div",
      { class: "control stopping" },
      this.button,
      el(
        "span",
        { class: "sr", id: "stop-help" },
        "Software stop, also with the space bar. It is no emergency stop: that has to cut the power.",
      ),
    );
    tips.attach(
      this.button,
      () => "Software stop (space bar). It does not replace an emergency stop that cuts the power.",
    );
    link.on("state", ({ status }) =>
      setAttribute(
        this.button,
        "data-calm",
        ["stopped", "fault"].includes(status.mode) && !link.isStale() ? "" : null,
      ),
    );
    link.on("down", () => setAttribute(this.button, "data-calm", null));
  }
}
