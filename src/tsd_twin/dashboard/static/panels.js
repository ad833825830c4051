// The tabs of viser's panel that we fill: viser makes empty places, and makes them anew when it
// connects again.

import { el } from "./dom.js";
import { Gear } from "./gear.js";
import { Health } from "./health.js";
import { Joints } from "./joints.js";
import { nameControls } from "./names.js";
import { Plots } from "./plots.js";
import { Recorder } from "./recorder.js";
import { RouteForm } from "./route_form.js";

/** Fill all places that there are and that will come, and name what viser leaves without a name. */
export function watchPanels(link, going, bringUp) {
  const recorder = new Recorder(link);
  const makers = {
    route: (place) => new RouteForm(link, going, place),
    joints: (place) => new Joints(link, place, bringUp),
    gear: (place) => new Gear(link, place),
    plots: (place) => new Plots(recorder, place),
    health: (place) => new Health(link, place),
  };
  const filled = new Map();
  const fill = () => {
    nameControls();
    for (const [place, content] of filled) {
      if (place.isConnected) continue;
      content.close();
      filled.delete(place);
    }
    for (const place of document.querySelectorAll("[data-tsd]")) {
      const make = makers[place.dataset.tsd];
      if (make !== undefined && !filled.has(place)) filled.set(place, make(shadow(place)));
    }
  };
  let waiting = false;
  new MutationObserver(() => {
    if (waiting) return;
    waiting = true;
    setTimeout(() => ((waiting = false), fill()), 50);
  }).observe(document.body, { childList: true, subtree: true });
  fill();
}

const STYLES = {
  route: ["route_form"],
  joints: ["gimbals", "wheels"],
  gear: ["gear"],
  plots: ["plots"],
  health: ["health"],
};

function shadow(place) {
  const root = place.shadowRoot ?? place.attachShadow({ mode: "open" });
  const styles = ["base", "panel", ...STYLES[place.dataset.tsd]];
  root.replaceChildren(
    ...styles.map((name) => el("link", { rel: "stylesheet", href: `static/${name}.css` })),
  );
  return root;
}
