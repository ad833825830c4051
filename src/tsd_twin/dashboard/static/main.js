// Overlay of controls over viser's scene, always visible.

import { Account } from "./account.js";
import { tooltip } from "./button.js";
import { CanvasFrame } from "./canvas_frame.js";
import { ConsistencyWarning } from "./consistency.js";
import { el, setAttribute, setText } from "./dom.js";
import { Joystick, SpeedLevel, StopButton, TurnSlider } from "./drive_controls.js";
import { Drive } from "./drive.js";
import { FloorMap } from "./map.js";
import { FirstSteps } from "./first_steps.js";
import { Gamepad } from "./gamepad.js";
import { HandOver } from "./handover.js";
import { KeySheet } from "./key_sheet.js";
import { Keyboard } from "./keyboard.js";
import { kindOf } from "./kinds.js";
import { assertDefined, Link } from "./link.js";
import { ModuleInset } from "./module_inset.js";
import { Notices, StaleBanner, StopAlarm } from "./notices.js";
import { typedName } from "./operator_name.js";
import { PanelSliders } from "./panel_sliders.js";
import { fillPanelTabs } from "./panel_tabs.js";
import { LATCHED, driveBlockedReason, SHOWS_RECORDING, showsRecording } from "./blocked_reasons.js";
import { PoseReadout } from "./pose_readout.js";
import { isNotable, noticeOf, sentence } from "./reasons.js";
import { takeMotionNote } from "./reload_note.js";
import { SphereGoTo } from "./sphere.js";
import { StatusBar } from "./status_bar.js";
import { StatusCard } from "./status_card.js";
import { TimelineBar } from "./timeline.js";
import { ViewKeeper } from "./view_settings.js";
import { Waypoints } from "./waypoints.js";

const NARROW_PX = 600; // As in small.css.
// Up to these widths, the bar has no room for the level; with several robots it also shows their
// names.
const LEVEL_IN_DOCK_PX = 1060;
const LEVEL_IN_DOCK_SEVERAL_PX = 1230;
const TOLD_MS = 1000;
let notifiedMs = -Infinity; // Time of the last notice about the end of a motion.
let takenMs = -Infinity; // Time of the last notice about a take-over.
// Later style sheets hide elements styled by earlier ones.
const STYLES = [
  ...["base", "frame", "bar", "buttons", "notices", "card", "dock"],
  ...["key_sheet", "first_steps", "small", "account", "module", "map", "timeline"],
];

const link = new Link(window.tsd.page, typedName());
const drive = new Drive(link);
const host = el("div", { id: "tsd-overlay" });
const root = host.attachShadow({ mode: "open" });
const frame = new CanvasFrame(host);
const notices = new Notices(link);
const stop = () => drive.stop();

const handOver = new HandOver(link, notices);
const bar = new StatusBar(link, handOver, () => fold(!inner.hasAttribute("data-folded")));
const level = new SpeedLevel(link, drive);
const stale = new StaleBanner(link);
const alarm = new StopAlarm(drive);
const keySheet = new KeySheet(root);
const firstSteps = new FirstSteps(link);
const consistency = new ConsistencyWarning(link);
const card = new StatusCard(link);
const stick = new Joystick(drive);
const turn = new TurnSlider(drive);
const stopButton = new StopButton(link, stop);
const sliders = new PanelSliders(drive, link, (event) => frame.isPanel(event));
const sphereGoTo = new SphereGoTo(drive, link, (event) => frame.isScene(event));
const waypoints = new Waypoints(drive, link);
const view = new ViewKeeper(link);
const map = new FloorMap(link, waypoints);
const preview = el(
  "div.preview",
  { hidden: true },
  "PREVIEW",
  el("span", "the sliders move your picture only, the robot stays put"),
);
const alone = el(
  "div.preview.alone",
  { hidden: true, role: "status" },
  "KEEPS DRIVING",
  el("span", "no hand is on a control: STOP, Zero or any control ends it"),
);
const axes = el("button.button.quiet.axes", { type: "button", onclick: () => turnAxes() });
const replay = el(
  "div.preview",
  { hidden: true, role: "status" },
  "RECORDING",
  el("span", "a replay is in view, not a robot: STOP stops all live robots"),
);

const left = el("div.left", stick.element);
const right = el("div.right", turn.element);
const dock = el("div.dock", stopButton.element, left, right); // STOP is first in tab order.
const pose = new PoseReadout(link, map.button);
const messages = el(
  "div.messages",
  ...[stale.banner, alarm.element, alone, replay, consistency.element, preview],
  ...[handOver.element, notices.element, keySheet.element],
);
// The dock is always at the bottom; content without room above it scrolls.
const inner = el(
  "div.frame",
  stale.veil,
  waypoints.floor.element,
  map.element, // Above the scene, below all controls.
  new ModuleInset(link).element, // Below notices, card and controls.
  dock,
  el(
    "div.upper",
    bar.element,
    el("div.middle", firstSteps.element, card.element, messages),
    pose.element,
  ),
  tooltip.element,
);
const account = new Account(link, inner);
const timeline = new TimelineBar(link, inner);
inner.append(timeline.element);
bar.element.append(account.element);
stopButton.element.append(account.watching);
const key = (/** @type {string} */ name) => el("kbd", name);
const keysHelp = el(
  "button.keys",
  { type: "button", onclick: () => keySheet.toggle() },
  el("span.drive", key("W A S D"), " · ", key("Q E"), " · gamepad \u2003 "),
  ...[key("space"), " = stop \u2003 ", key("?"), " = all keys"],
);
stopButton.element.append(keysHelp);
stopButton.button.after(waypoints.element); // Above STOP, and after it in tab order.
stick.head.append(axes);

const keys = new Keyboard(drive, {
  focused: forwardKeyToFocused,
  stop: (isOnBox) => {
    stop();
    if (isOnBox) notices.say("The space bar is STOP. Enter ticks a box.");
  },
});
for (const source of [stick, turn, keys, new Gamepad(drive, stop), sliders, sphereGoTo, waypoints])
  drive.add(source);
drive.onChange(draw);
drive.onMessage = ({ text, again, key }, isTrue) => {
  if (!again || isFirstToTell()) notices.say(text, unlessLatched(isTrue), key);
};
link.on(["state", "beat"], draw);
link.on("event", (event) => {
  if (event.past || !isNotable(event, link.welcome?.operator)) return;
  if (event.why.code === "lease_taken_over")
    takenMs = performance.now(); // It includes the reason, so the loss is not reported again.
  else if (event.kind === "lease" && performance.now() - takenMs < TOLD_MS) return;
  const { text, again, key } = noticeOf(event, link.state?.has_control ?? false);
  const isTrue = () => event.kind !== "mode" || !isLatched();
  if (!again || isFirstToTell()) notices.say(text, isTrue, key);
});
link.on("reply", ({ to, ok, why }) => {
  if (!ok && to !== "stop") notices.say(why ? sentence(why) : "The request was refused.");
  if (ok && to === "stop" && showsRecording(link)) notices.say("The live robots are stopped.");
});
card.onReset = () => {
  // Only if the operator is not elsewhere by now.
  if (document.activeElement === document.body) bar.arm.button.focus();
};
link.on(["welcome", "robot"], showColour);
link.on("robot", (robot) => {
  document.title = `${robot.title} · tsd-twin`;
  axes.hidden = !kindOf(robot).onFloor; // Its base is the world.
  if (axes.hidden && drive.frame !== "base_link") turnAxes("base_link");
});
tooltip.attach(stick.pad, () => driveBlockedReason(link) ?? kindOf(link.robot).controls.help);
tooltip.attach(turn.track, () => driveBlockedReason(link) ?? "Left turns left");
tooltip.attach(axes, () => "Up on the stick: forward of the robot, or along x of the world");

inner.style.visibility = "hidden"; // Until the styles are loaded.
let missing = STYLES.length;
const onload = () => {
  missing -= 1;
  if (missing === 0) inner.style.removeProperty("visibility");
};
const sheet = (/** @type {string} */ name) => ({ rel: "stylesheet", href: `static/${name}.css` });
// Unstyled controls are better than none, because they include STOP.
root.append(...STYLES.map((name) => el("link", sheet(name), { onload, onerror: onload })), inner);
document.head.append(el("link", sheet("colours")), el("link", sheet("page")));
document.body.prepend(host); // Before the panel in tab order.
inner.toggleAttribute("data-plain", window.tsd.lowDetail); // Blur effects halve the frame rate.
for (const element of [bar.element, dock, waypoints.element])
  new ResizeObserver(reserve).observe(element);
new ResizeObserver(layOut).observe(host);
frame.phone.addEventListener("change", layOut);
layOut();
fold(false);
turnAxes("base_link");
fillPanelTabs(link, waypoints, sphereGoTo, { keySheet, firstSteps }, view, stop);
if (takeMotionNote())
  notices.say(
    "This page was loaded again while it drove, so the robot stopped. Take control to go on.",
  );
link.open();

/** Page, server and robot may all report the end of a motion; only the first one is shown. */
function isFirstToTell() {
  const nowMs = performance.now();
  const isFirst = nowMs - notifiedMs > TOLD_MS;
  if (isFirst) notifiedMs = nowMs;
  return isFirst;
}

function isLatched() {
  return LATCHED.has(link.state?.status.mode ?? "");
}

/**
 * Hide the advice after an automatic stop once the robot is latched, because its card has details.
 * @param {() => boolean} [isTrue]
 */
function unlessLatched(isTrue = () => true) {
  const wasLatched = isLatched();
  return () => isTrue() && (wasLatched || !isLatched());
}

/** @param {KeyboardEvent} event */
function forwardKeyToFocused(event) {
  for (const each of [keySheet, timeline, waypoints, map, view]) if (each.key(event)) return true;
  const focused = root.activeElement;
  if (focused === stick.pad) return stick.key(event);
  if (focused === turn.track) return turn.key(event);
  return focused === card.reset.button && card.latched && card.reset.key(event);
}

function draw() {
  const { scale, twist } = drive;
  const refusal = driveBlockedReason(link);
  const { controls } = kindOf(link.robot);
  const byItself = sliders.held || sphereGoTo.held;
  const unit = byItself
    ? share(controls.unit([twist.vx, twist.vy, twist.omega]), scale)
    : drive.unit;
  const commanded =
    refusal === null ? share(commandedUnit(assertDefined(link.state)), scale) : null;
  const heading = drive.frame === "odom" ? 0 : (link.state?.pose?.[2] ?? null);
  stick.point(kindOf(link.robot).onFloor && !link.isStale() ? heading : null);
  stick.draw(unit, commanded, controls.labels);
  turn.draw(unit.turn, commanded?.turn ?? null, twist.omega);
  for (const node of [stick.pad, turn.track])
    setAttribute(node, "aria-disabled", refusal === null ? null : "true");
  const help = `Drag, or use the arrow keys. ${controls.help}. It springs back.`;
  setText(stick.help, refusal ?? help);
  preview.hidden = !sliders.preview;
  alone.hidden = !sliders.driveAlone;
  replay.hidden = link.state?.source !== "recording" || SHOWS_RECORDING; // The timeline shows it.
}

/** Colour that identifies this robot among several. */
function showColour() {
  const robots = link.welcome?.robots ?? [];
  const shown = robots.find(({ id }) => id === link.robot?.id);
  inner.toggleAttribute("data-several", robots.length > 1 && shown !== undefined);
  inner.style.setProperty("--robot", shown?.colour ?? "transparent");
  layOut();
}

/** @param {Unit} unit @param {{ speed: number, turn: number }} scale */
function share({ x, y, turn: rate }, { speed, turn: most }) {
  return {
    x: speed > 0 ? x / speed : 0,
    y: speed > 0 ? y / speed : 0,
    turn: most > 0 ? rate / most : 0,
  };
}

/** Return the commanded twist along the stick axes. @param {RobotState} state */
function commandedUnit({ commanded, pose: at }) {
  const { x, y, turn: rate } = kindOf(link.robot).controls.unit(commanded ?? [0, 0, 0]);
  const heading = drive.frame === "odom" ? (at?.[2] ?? 0) : 0;
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return { x: c * x - s * y, y: s * x + c * y, turn: rate };
}

/** @param {"base_link" | "odom"} to */
function turnAxes(to = drive.frame === "odom" ? "base_link" : "odom") {
  drive.release(); // The same deflection would mean another direction.
  drive.frame = to;
  setText(axes, to === "odom" ? "world axes" : "robot axes");
  axes.toggleAttribute("data-world", to === "odom");
}

/** @param {boolean} folded */
function fold(folded) {
  inner.toggleAttribute("data-folded", folded);
  bar.showFolded(folded);
  if (folded) drive.release();
}

function isNarrow() {
  return host.clientWidth <= NARROW_PX;
}

function layOut() {
  // Moving an element drops focus and pointer, so move it only if needed.
  const several = (link.welcome?.robots.length ?? 0) > 1;
  const widest = several ? LEVEL_IN_DOCK_SEVERAL_PX : LEVEL_IN_DOCK_PX;
  const levelPlace = host.clientWidth <= widest ? right : bar.level;
  if (level.element.parentElement !== levelPlace) levelPlace.prepend(level.element);
  inner.toggleAttribute("data-drawer", frame.phone.matches);
  reserve();
}

function reserve() {
  const box = host.getBoundingClientRect();
  const lowest = isNarrow() ? pose.element : bar.element;
  const top = lowest.getBoundingClientRect().bottom - box.top;
  const above = isNarrow() && !waypoints.element.hidden;
  const bottom = box.bottom - (above ? waypoints.element : dock).getBoundingClientRect().top;
  frame.reserve(top, bottom + 8);
  inner.style.setProperty("--bar", `${bar.element.offsetHeight}px`);
}
