// Field selection for the plots.

import { el } from "./dom.js";
import { MAX_FIELDS } from "./plot_recorder.js";

export class PlotChooser {
  /** @param {Recorder} recorder @param {() => void} onChange */
  constructor(recorder, onChange) {
    this._recorder = recorder;
    this._onChange = onChange;
    this._list = el("div.list", { role: "group", "aria-label": "Fields" });
    const oninput = () => this._fill();
    this._find = el("input", { type: "search", "aria-label": "Find a field", oninput });
    this._find.placeholder = "Find";
    const usual = { type: "button", onclick: () => this._choose(null) };
    this.element = el(
      "div.chooser",
      { hidden: true },
      el("div.tools", this._find, el("button.button", usual, "Usual fields")),
      this._list,
    );
    this.button = el("button.button", { type: "button", onclick: () => this._toggle() }, "Fields");
    this.button.setAttribute("aria-expanded", "false");
  }

  _toggle() {
    this.element.hidden = !this.element.hidden;
    this.button.setAttribute("aria-expanded", String(!this.element.hidden));
    if (this.element.hidden) return;
    this._recorder.search();
    this._fill();
    this._find.focus();
  }

  _fill() {
    const words = this._find.value.toLowerCase().split(" ");
    const found = [...this._recorder.known.values()].filter(({ name, title }) =>
      words.every((word) => `${name} ${title}`.toLowerCase().includes(word)),
    );
    this._list.replaceChildren(...found.map((field) => this._item(field)));
  }

  /** Use a button, pressed by Enter, because the space bar is STOP. @param {PlotField} field */
  _item({ name, unit }) {
    const { names } = this._recorder;
    const isChosen = names.includes(name);
    const isRefused = !isChosen && names.length >= MAX_FIELDS;
    const choice = isChosen ? names.filter((each) => each !== name) : [...names, name];
    const attributes = {
      type: "button",
      role: "checkbox",
      "aria-checked": String(isChosen),
      "aria-disabled": isRefused && "true",
      title: isRefused && `${MAX_FIELDS} fields at most`,
      onclick: () => isRefused || this._choose(choice, name),
    };
    return el("button.field", attributes, el("span", name), el("span.unit", unit));
  }

  /** @param {string[] | null} names @param {string} [focused] */
  _choose(names, focused) {
    this._recorder.choose(names);
    this._fill();
    for (const item of this._list.children)
      if (item instanceof HTMLElement && item.firstChild?.textContent === focused) item.focus();
    this._onChange();
  }
}
