// Content of the tabs of viser's panel: viser makes empty places, and makes them anew on reconnection.

import { addAriaLabels } from "./aria_labels.js";
import { el } from "./dom.js";
import { Gimbals } from "./gimbals.js";
import { Health } from "./health.js";
import { Plots, Recorder } from "./plots.js";
import { Sphere } from "./sphere.js";
import { WaypointForm } from "./waypoint_form.js";
import { WheelSpeed } from "./wheel_speed.js";
import { Wheels } from "./wheels.js";

// Tab of the actuators; its content depends on the robot.
const PANELS = { gimbals: Gimbals, wheels: Wheels, sphere: Sphere };

export class ActuatorTab {
  /** @param {Link} link @param {ShadowRoot} place @param {SphereGoTo} sphereGoTo */
  constructor(link, place, sphereGoTo) {
    this._link = link;
    this._sphereGoTo = sphereGoTo;
    /** @type {RobotInfo["panel"] | null} */
    this._kind = null;
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
    this._content = new PANELS[kind](this._link, this._place, this._sphereGoTo);
  }
}

// The tabs of viser's panel that we fill: viser makes empty places, and makes them anew when it
// connects again.
/**
 * Fill all places that there are and that will come, and name what viser leaves without a name.
 * @param {Link} link
 * @param {Waypoints} going
 * @param {SphereGoTo} sphereGoTo
 */
export function fillPanelTabs(link, going, sphereGoTo) {
  const recorder = new Recorder(link);
  /** @type {Record<string, (place: ShadowRoot) => { close(): void }>} */
  const contents = {
    route: (place) => new WaypointForm(link, going, place),
    joints: (place) => new ActuatorTab(link, place, sphereGoTo),
    wheel_speed: (place) => new WheelSpeed(link, place),
    plots: (place) => new Plots(recorder, place),
    health: (place) => new Health(link, place),
  };
  /** @type {Map<Element, { close(): void }>} */
  const filled = new Map();
  const fill = () => {
    addAriaLabels();
    for (const [place, content] of filled) {
      if (place.isConnected) continue;
      content.close();
      filled.delete(place);
    }
    for (const place of /** @type {NodeListOf<HTMLElement>} */ (
      document.querySelectorAll("[data-tsd]")
    )) {
      const make = contents[place.dataset.tsd ?? ""];
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

/** @type {Record<string, string[]>} */
const STYLES = {
  route: ["waypoint_form"],
  joints: ["gimbals", "wheels"],
  wheel_speed: ["wheel_speed"],
  plots: ["plots"],
  health: ["health"],
};

/** @param {HTMLElement} place */
function shadow(place) {
  const root = place.shadowRoot ?? place.attachShadow({ mode: "open" });
  const styles = ["base", "panel", ...STYLES[place.dataset.tsd ?? ""]];
  root.replaceChildren(
    ...styles.map((name) => el("link", { rel: "stylesheet", href: `static/${name}.css` })),
  );
  return root;
}
