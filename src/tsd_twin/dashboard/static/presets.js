// Tab and layer presets for driving, learning and debugging. The choice is kept in the browser.

import { el, setAttribute } from "./dom.js";
import { keep, recall } from "./memory.js";
import { LAYERS } from "./view_settings.js";

const KEY = "tsd.preset";

/**
 * Hidden tabs, visible layers and other settings of each preset. The View tab is always visible.
 * @type {Record<string, { away: string[], layers: string[], view: Partial<ViewSettings> }>}
 */
export const PRESETS = {
  Operator: {
    away: ["Gimbals", "Wheels", "Sphere", "Joints", "Plots", "Student"],
    layers: ["trail", "planned path", "predicted pose", "stop envelope", "labels"],
    view: { true_pose: "never", tilt: "x1" },
  },
  Student: {
    away: ["Health"],
    layers: ["set-point", "true pose", "trail", "planned path", "thrust arrows", "labels"],
    view: { true_pose: "when it differs", tilt: "x3" },
  },
  Debug: { away: [], layers: LAYERS, view: { true_pose: "always", tilt: "x1" } },
};

/** Names of hidden tabs. @returns {string[]} */
export function tabsAway() {
  return PRESETS[recall(KEY) ?? ""]?.away ?? [];
}

/** Preset buttons in the View tab. */
export class Presets {
  /** @param {ShadowRoot} place @param {ViewKeeper} view @param {() => void} onChange */
  constructor(place, view, onChange) {
    const show = () => {
      for (const button of buttons)
        setAttribute(button, "aria-pressed", String(button.textContent === recall(KEY)));
    };
    const buttons = Object.entries(PRESETS).map(([name, { layers, view: settings }]) =>
      el(
        "button.button",
        {
          type: "button",
          onclick: () => {
            keep(KEY, name);
            view.change({ ...settings, hidden: LAYERS.filter((layer) => !layers.includes(layer)) });
            show();
            onChange();
          },
        },
        name,
      ),
    );
    show();
    const hint = "Tabs and layers to drive, to learn how it works, or to look for a fault.";
    place.append(
      el(
        "section.settings",
        { role: "group", "aria-label": "Preset" },
        el("div.presets", ...buttons),
      ),
      el("p.muted", hint),
    );
  }
}
