// Contents of viser's panel tabs, which viser creates empty, and again after reconnecting.

import { el, setAttribute } from "./dom.js";
import { Health } from "./health.js";
import { kindOf } from "./kinds.js";
import { PageSettings } from "./page_settings.js";
import { Recorder } from "./plot_recorder.js";
import { Plots } from "./plots.js";
import { Presets, tabsAway } from "./presets.js";
import { Student } from "./student.js";
import { StudentModel } from "./student_model.js";
import { WaypointForm } from "./waypoint_form.js";
import { WheelSpeed } from "./wheel_speed.js";

const REFRESH_MS = 50;
const UNNAMED = "[role=slider], input[type=text]";
/** @type {Record<string, string>} Names for unlabelled viser elements, by icon or class. */
const NAMES = {
  ".mantine-ActionIcon-root:has(.tabler-icon-adjustments)": "Configuration and diagnostics",
  ".mantine-ActionIcon-root:has(.tabler-icon-arrow-back)": "Back to the controls",
  ".mantine-Notification-closeButton": "Close this notice",
};
const SLOW_SCENE = "Software WebGL rendering detected"; // Also shown in the Health tab.
const LABEL_LEVELS = 8; // Maximum number of levels between a control and viser's label.

/** @type {Record<string, string[]>} */
const STYLES = {
  route: ["waypoint_form"],
  joints: ["gimbals", "wheels"],
  wheel_speed: ["wheel_speed"],
  plots: ["buttons", "vendor/uPlot.min", "plots"],
  health: ["health"],
  student: ["student", "module"],
  presets: ["page_settings", "presets"],
  page: ["page_settings"],
};

/**
 * Fill all current and future tabs, and label unlabelled viser elements.
 * @param {Link} link @param {Waypoints} waypoints @param {SphereGoTo} sphereGoTo
 * @param {Guides} guides @param {ViewKeeper} view @param {() => void} stop
 */
export function fillPanelTabs(link, waypoints, sphereGoTo, guides, view, stop) {
  const recorder = new Recorder(link);
  const scheme = () => getComputedStyle(document.documentElement).colorScheme;
  window.tsdPlots = { recorder, stop, scheme }; // For the plots window.
  const model = new StudentModel(link, location.search);
  /** @type {Record<string, (place: ShadowRoot, signal: AbortSignal) => unknown>} */
  const contents = {
    route: (place, signal) => new WaypointForm(link, place, signal, waypoints),
    joints: (place, signal) => fillActuatorTab(link, place, signal, sphereGoTo),
    wheel_speed: (place, signal) => new WheelSpeed(link, place, signal),
    plots: (place, signal) => new Plots(recorder, place, signal),
    health: (place, signal) => new Health(link, place, signal),
    student: (place, signal) => new Student(link, place, signal, model),
    presets: (place) => new Presets(place, view, putTabsAway),
    page: (place, signal) => new PageSettings(link, place, signal, guides),
  };
  /** @type {Map<HTMLElement, AbortController>} */
  const filled = new Map();
  const fill = () => {
    addAriaLabels();
    closeSlowSceneNotice();
    putTabsAway();
    if (model.isLinked && openTab("Student")) model.isLinked = false;
    for (const [place, controller] of filled) {
      if (place.isConnected) continue;
      controller.abort();
      filled.delete(place);
    }
    /** @type {NodeListOf<HTMLElement>} */
    const places = document.querySelectorAll("[data-tsd]");
    for (const place of places) {
      const name = place.dataset.tsd ?? "";
      if (!(name in contents) || filled.has(place)) continue;
      const controller = new AbortController();
      filled.set(place, controller);
      contents[name](shadow(place, STYLES[name]), controller.signal);
    }
  };
  let isWaiting = false;
  new MutationObserver(() => {
    if (isWaiting) return;
    isWaiting = true;
    setTimeout(() => ((isWaiting = false), fill()), REFRESH_MS);
  }).observe(document.body, { childList: true, subtree: true });
  fill();
}

/**
 * Fill the actuator tab, again when a robot of another kind is selected.
 * @param {Link} link @param {ShadowRoot} place @param {AbortSignal} signal
 * @param {SphereGoTo} sphereGoTo
 */
function fillActuatorTab(link, place, signal, sphereGoTo) {
  const content = el("div");
  place.append(content);
  let controller = new AbortController();
  /** @type {Kind["Panel"] | null} */
  let shown = null;
  const show = () => {
    const { Panel } = kindOf(link.robot);
    if (Panel === shown) return;
    shown = Panel;
    controller.abort();
    controller = new AbortController();
    content.replaceChildren();
    new Panel(link, content, controller.signal, sphereGoTo);
  };
  link.on("robot", show, signal);
  signal.addEventListener("abort", () => controller.abort());
  show();
}

/** @param {HTMLElement} place @param {string[]} styles */
function shadow(place, styles) {
  const root = place.shadowRoot ?? place.attachShadow({ mode: "open" });
  const links = ["base", "panel", ...styles].map((name) =>
    el("link", { rel: "stylesheet", href: `static/${name}.css` }),
  );
  root.replaceChildren(...links);
  return root;
}

/**
 * Bring a tab to the front if it exists, because viser creates contents lazily. Docked tabs of
 * viser respond to keys, drawer tabs to clicks.
 * @param {string} name
 */
function openTab(name) {
  const tabs = /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[role=tab]"));
  const tab = [...tabs].find((each) => each.textContent.trim() === name);
  tab?.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
  tab?.click();
  return tab !== undefined;
}

/** Hide the tabs excluded by the preset, but never the open one. */
function putTabsAway() {
  const away = tabsAway();
  for (const tab of document.querySelectorAll("[role=tab]")) {
    const isAway = away.includes(tab.textContent.trim());
    tab.toggleAttribute("data-tsd-away", isAway && tab.getAttribute("aria-selected") !== "true");
  }
}

/** Close viser's software-rendering notice, which covers the robot or the map. */
function closeSlowSceneNotice() {
  for (const title of document.querySelectorAll(".mantine-Notification-title")) {
    if (title.textContent !== SLOW_SCENE) continue;
    const notice = /** @type {HTMLElement} */ (title.closest(".mantine-Notification-root"));
    notice.style.display = "none"; // Hide immediately, because a busy page delays the transition.
    /** @type {HTMLElement | null} */
    (notice.querySelector(".mantine-Notification-closeButton"))?.click();
  }
}

/** @type {WeakSet<Element>} Controls labelled here; labels change with the robot. */
const namedHere = new WeakSet();

/** Label viser's sliders and fields from the text in their rows, which is only visual. */
function addAriaLabels() {
  for (const control of document.querySelectorAll(UNNAMED)) {
    // viser's sliders have an empty name.
    const named = control.getAttribute("aria-label") || control.getAttribute("aria-labelledby");
    const hasLabel = control instanceof HTMLInputElement && control.labels?.length;
    if ((named && !namedHere.has(control)) || hasLabel) continue;
    const label = labelOf(control);
    if (label === null) continue;
    setAttribute(control, "aria-label", label);
    namedHere.add(control);
  }
  for (const box of document.querySelectorAll("input[type=checkbox]:not([aria-description])"))
    box.setAttribute("aria-description", "Enter ticks it; the space bar stops the robot.");
  for (const [selector, name] of Object.entries(NAMES))
    for (const button of document.querySelectorAll(selector))
      setAttribute(button, "aria-label", name);
}

/** @param {Element} control */
function labelOf(control) {
  let row = control.parentElement;
  for (let i = 0; i < LABEL_LEVELS && row !== null; i++, row = row.parentElement) {
    const text = row.querySelector("p")?.textContent.trim();
    if (text) return text;
  }
  return null;
}
