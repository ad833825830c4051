// Timeline of a recording, above viser's playback bar: events, marks, mode and speed.
//
// The bar has the clock: its slider says the time, and a number in its field sets it.

/**
 * @typedef {{ t_s: number, robot: string, kind: string, text: string, count: number }}
 *   RecordedEvent
 * @typedef {{ id: string, colour: string, unit: string, modes: [number, string][],
 *   speeds: (number | null)[] }} Robot
 * @typedef {{ name: string, start_ms: number, duration_s: number, hz: number, robots: Robot[],
 *   events: RecordedEvent[] }} Recording
 */

/** @type {Recording} */
const recording = JSON.parse(
  /** @type {HTMLElement} */ (document.getElementById("tsd-recording")).textContent,
);
const events = recording.events.sort((one, other) => one.t_s - other.t_s);
const SIGNS = /** @type {Record<string, string>} */ ({
  stop: "■",
  drop: "↓",
  fault: "!",
  "hand-over": "⇄",
  consistency: "≠",
  mark: "◆",
});
const STEP_S = 0.05;
const FRAME_S = 1 / 30;
/** @type {Record<string, () => void>} */
const KEYS = {
  n: () => jump(1),
  p: () => jump(-1),
  ".": () => show(now() + FRAME_S),
  ",": () => show(now() - FRAME_S),
};

/**
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag @param {string} name @param {string} [text]
 */
function element(tag, name, text = "") {
  const node = document.createElement(tag);
  node.className = name;
  node.textContent = text;
  return node;
}

/** The slider of the playback bar, once it is there. */
function slider() {
  return document.querySelector('[role="slider"][aria-valuemax]');
}

/** Return the time that is shown, in seconds. */
function now() {
  return Number(slider()?.getAttribute("aria-valuenow") ?? 0);
}

/** Show a time; playing is paused by that. @param {number} t_s */
function show(t_s) {
  const field = document.querySelector("input[inputmode]");
  if (!(field instanceof HTMLInputElement)) return;
  const value = Math.min(Math.max(t_s, 0), recording.duration_s).toFixed(2);
  // Use the browser's own setter, as typing does; the bar reacts to no other assignment.
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value")?.set?.call(field, value);
  field.dispatchEvent(new Event("input", { bubbles: true }));
}

/** Jump to the next event, or to the one before. @param {1 | -1} direction */
function jump(direction) {
  const t_s = now();
  const next =
    direction > 0
      ? events.find((each) => each.t_s > t_s + STEP_S)
      : events.findLast((each) => each.t_s < t_s - STEP_S);
  if (next) show(next.t_s);
}

/** @param {Robot} robot @param {number} t_s */
function stateOf(robot, t_s) {
  const mode = robot.modes.findLast(([since]) => since <= t_s + 1e-3)?.[1] ?? "";
  const speed = robot.speeds[Math.min(Math.floor(t_s * recording.hz), robot.speeds.length - 1)];
  const shown = speed === null || speed === undefined ? "–" : speed.toFixed(2);
  return `${robot.id} ${mode ? mode.toUpperCase() : "not there"} ${shown} ${robot.unit}`;
}

/** @param {HTMLCanvasElement} canvas */
function draw(canvas) {
  const scale = devicePixelRatio;
  const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
  Object.assign(canvas, { width, height });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  for (const robot of recording.robots) {
    const largest = Math.max(0.1, ...robot.speeds.map((each) => each ?? 0));
    context.strokeStyle = robot.colour;
    context.lineWidth = 1.5 * scale;
    context.beginPath();
    robot.speeds.forEach((speed, i) => {
      const x = (i / recording.hz / recording.duration_s) * width;
      const y = height - 2 - ((speed ?? 0) / largest) * (height - 18 * scale);
      if (i === 0) context.moveTo(x, y);
      else context.lineTo(x, y);
    });
    context.stroke();
  }
}

/** Make the lane above the playback bar, and its labels. @param {Element} bar */
function build(bar) {
  const label = element("div", "tsd-label");
  const title = element("b", "", "RECORDING");
  const clock = element("span", "tsd-clock");
  label.append(title, element("span", "", recording.name), clock);
  const states = recording.robots.map((robot) => {
    const state = element("span", "tsd-state");
    const dot = element("i", "");
    dot.style.background = robot.colour;
    const text = element("span", "");
    state.append(dot, text);
    label.append(state);
    return text;
  });

  const lane = element("div", "tsd-lane");
  const plot = element("div", "tsd-plot");
  const canvas = element("canvas", "");
  const cursor = element("div", "tsd-cursor");
  const note = element("div", "tsd-note");
  const back = element("button", "", "◀ event");
  const next = element("button", "", "event ▶");
  back.addEventListener("click", () => jump(-1));
  next.addEventListener("click", () => jump(1));
  plot.append(canvas);
  for (const event of events) {
    const sign = element("button", "tsd-event", SIGNS[event.kind] ?? "•");
    const often = event.count > 1 ? ` (${event.count} times)` : "";
    sign.dataset.kind = event.kind;
    sign.title = `${event.t_s.toFixed(1)} s ${event.kind}: ${event.text}${often}`;
    sign.setAttribute("aria-label", sign.title);
    sign.style.left = `${(100 * event.t_s) / recording.duration_s}%`;
    sign.addEventListener("click", () => show(event.t_s));
    plot.append(sign);
  }
  plot.append(cursor);
  /** @param {PointerEvent} pointer */
  const scrub = (pointer) => {
    const box = plot.getBoundingClientRect();
    show(((pointer.clientX - box.left) / box.width) * recording.duration_s);
  };
  plot.addEventListener("pointerdown", (pointer) => {
    if (pointer.target instanceof HTMLButtonElement) return;
    plot.setPointerCapture(pointer.pointerId);
    scrub(pointer);
  });
  plot.addEventListener("pointermove", (pointer) => {
    if (plot.hasPointerCapture(pointer.pointerId)) scrub(pointer);
  });
  addEventListener("keydown", (key) => {
    if (key.target instanceof HTMLInputElement || key.ctrlKey || key.metaKey || key.altKey) return;
    KEYS[key.key]?.();
  });
  next.title = "Key N; back with P. Keys . and , step by one frame, space plays and pauses.";
  label.append(note);
  lane.append(back, plot, next);
  bar.before(lane);
  document.body.append(element("div", "tsd-frame"), label);
  new ResizeObserver(() => {
    // Both have the same time axis as the slider.
    const track = slider()?.closest(".mantine-Slider-root")?.getBoundingClientRect();
    if (track) Object.assign(plot.style, { left: `${track.left}px`, width: `${track.width}px` });
    draw(canvas);
  }).observe(lane);

  const update = () => {
    const t_s = now();
    const at = new Date(recording.start_ms + 1000 * t_s);
    clock.textContent = `${at.toLocaleDateString()} ${at.toLocaleTimeString()}`;
    cursor.style.left = `${(100 * t_s) / recording.duration_s}%`;
    recording.robots.forEach((robot, i) => (states[i].textContent = stateOf(robot, t_s)));
    const last = events.findLast((each) => each.t_s <= t_s + STEP_S);
    note.textContent = last ? `${last.t_s.toFixed(1)} s ${last.kind}: ${last.text}` : "";
    requestAnimationFrame(update);
  };
  update();
}

document.title = recording.name;
const wait = setInterval(() => {
  // The bar holds the slider and the field of the time.
  let bar = slider()?.parentElement ?? null;
  while (bar && !bar.querySelector("input[inputmode]")) bar = bar.parentElement;
  if (!bar) return;
  clearInterval(wait);
  build(bar);
  Object.assign(window, { tsdShow: show }); // For who takes pictures of it.
}, 50);

export {}; // A module, whose names are its own.
