// Timeline: the past of the live robots, or a recording shown by this page. A recording has a
// separate scene and session on the server, in which only STOP affects robots.

import { Button } from "./button.js";
import { el, icon, setAttribute, setText, svg } from "./dom.js";
import { fixed } from "./format.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
const NEAR_S = 0.05;
const BACK_S = 30;
/** @type {Record<string, number>} Seconds. */
const ARROWS = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10 };
const NOTE_LENGTH = 200;
const SEND_MS = 50; // The server closes flooding sockets.
const PICTURE = { width: 72, height: 48, margin: 4 };
const SIGNS = /** @type {Record<string, string>} */ ({
  stop: "■",
  drop: "↓",
  fault: "!",
  "hand-over": "⇄",
  consistency: "≠",
  mark: "◆",
});

/** Rail with a cursor, moved by pointer and arrow keys. */
class Rail {
  /** @param {string} name @param {(share: number) => void} move @param {(step: number) => void} step */
  constructor(name, move, step) {
    this.cursor = el("i.cursor");
    this.slider = el(
      "div.slider",
      { role: "slider", tabindex: 0, "aria-label": name, "aria-valuenow": 0 },
      el("i.rail"),
      this.cursor,
    );
    this.element = el("div.place", this.slider);
    this._move = move;
    this.slider.addEventListener("pointerdown", (event) => this._scrub(event, true));
    this.slider.addEventListener("pointermove", (event) => this._scrub(event, false));
    this.slider.addEventListener("keydown", (event) => {
      const change = ARROWS[event.key];
      if (change === undefined) return;
      event.preventDefault();
      event.stopPropagation(); // Otherwise the camera moves too.
      step(change);
    });
  }

  /** @param {Element[]} signs */
  fill(signs) {
    // Keep the slider, because it may have focus or the pointer.
    for (const old of [...this.element.children].slice(1)) old.remove();
    this.element.append(...signs);
  }

  /** @param {number} share @param {string} text @param {number} value */
  draw(share, text, value) {
    this.cursor.style.left = `${100 * Math.max(0, Math.min(1, share))}%`;
    setAttribute(this.slider, "aria-valuenow", fixed(value, 2).replace("\u2212", "-"));
    setAttribute(this.slider, "aria-valuetext", text);
  }

  /** @param {PointerEvent} event @param {boolean} begins */
  _scrub(event, begins) {
    if (begins) this.slider.setPointerCapture(event.pointerId);
    else if (!this.slider.hasPointerCapture(event.pointerId)) return;
    const box = this.slider.getBoundingClientRect();
    this._move(Math.max(0, Math.min(1, (event.clientX - box.left) / box.width)));
  }
}

/** Sends the latest message, rate-limited. */
class Throttle {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    /** @type {TimelineRequest | PageMessage | null} */
    this._waiting = null;
    this._timer = 0;
  }

  /** @param {TimelineRequest | PageMessage} message */
  send(message) {
    this._waiting = message;
    if (this._timer === 0) this._flush();
  }

  _flush() {
    this._timer = 0;
    if (this._waiting === null) return;
    this._link.send(this._waiting);
    this._waiting = null;
    this._timer = setTimeout(() => this._flush(), SEND_MS);
  }
}

export class TimelineBar {
  /** Marks `frame` when this page shows a recording. @param {Link} link @param {HTMLElement} frame */
  constructor(link, frame) {
    this._link = link;
    this._frame = frame;
    this._throttle = new Throttle(link);
    /** @type {Timeline | null} */
    this._timeline = null;
    /** @type {Cursor} */
    this._cursor = { t: "cursor", t_s: 0, playing: false, speed: 1 };
    /** @type {number | null} */
    this._agoS = null;
    this.recording = window.tsd.recording;
    this._list = new RecordingList(this.recording);
    this._word = el("span.word", { role: "status", "aria-label": "What is shown" });
    this._time = el("span.time.number", { role: "status", "aria-label": "Time" });
    this.element = el("section.timeline.surface", { "aria-label": "Timeline", hidden: true });
    frame.append(this._list.element);
    frame.toggleAttribute("data-recording", this.recording !== null);
    if (this.recording === null) this._showLive();
    else this._showRecording(this.recording);
  }

  /** Handle a key event; return whether it was for the timeline. @param {KeyboardEvent} event */
  key(event) {
    if (event.code === "Escape" && this._list.isOpen) {
      if (event.type === "keydown") this._list.toggle(false);
      return true;
    }
    const act = this._keys[event.key.toLowerCase()];
    const isPlots = event.target instanceof Element && event.target.closest('[data-tsd="plots"]');
    if (act === undefined || isPlots) return false; // P pauses focused plots.
    if (event.type === "keydown" && (!event.repeat || event.key === "." || event.key === ","))
      act();
    return true;
  }

  /** @type {Record<string, () => void>} */
  get _keys() {
    if (this.recording === null)
      return this._agoS === null ? {} : { l: () => this._lookBack(null) };
    return {
      l: () => goTo(null),
      k: () => this._toggle(),
      n: () => this._jump(1),
      p: () => this._jump(-1),
      ".": () => this._link.send({ t: "step", back: false }),
      ",": () => this._link.send({ t: "step", back: true }),
      b: () => this._openNote(true),
    };
  }

  // Live: the last 30 s, drawn next to the robot.

  async _showLive() {
    this._rail = new Rail(
      "Time in the last 30 seconds",
      (share) => this._lookBack(BACK_S * (1 - share)),
      (step) => this._lookBack((this._agoS ?? 0) - step),
    );
    setAttribute(this._rail.slider, "aria-valuemin", -BACK_S);
    setAttribute(this._rail.slider, "aria-valuemax", 0);
    this._now = new Button("Now", () => this._lookBack(null), { kind: "quiet", tip: "Key L" });
    this._now.element.hidden = true;
    this.element.append(
      this._word,
      el("span.caption", "\u2212 30 s"),
      this._rail.element,
      this._time,
      this._now.element,
      this._list.button.element,
    );
    this._drawLive(null);
    this._link.on("state", ({ past }) => this._drawLive(past));
    this._link.on(["robot", "up"], () => (this._agoS = null));
    this.element.hidden = !(await this._list.fill());
  }

  /** Also draw the robot as it was `agoS` ago, or stop doing so. @param {number | null} agoS */
  _lookBack(agoS) {
    const isNow = agoS === null || agoS < 0.1;
    this._agoS = isNow ? null : Math.min(BACK_S, Math.round(10 * agoS) / 10);
    this._throttle.send({ t: "look_back", history_offset_s: this._agoS });
    this._drawLive(null);
  }

  /** @param {PastState | null} past */
  _drawLive(past) {
    const ago = this._agoS;
    const isBack = ago !== null;
    this._frame.toggleAttribute("data-past", isBack);
    setText(this._word, isBack ? `GHOST ${fixed(ago, 1)} s AGO` : "LIVE");
    const speed = past?.twist ? Math.hypot(past.twist[0], past.twist[1]) : null;
    const said = past === null || ago === null ? "nothing is kept of then" : told(past, speed);
    setText(this._time, isBack ? said : "");
    if (this._now) this._now.element.hidden = !isBack;
    this._rail?.draw(
      1 - (ago ?? 0) / BACK_S,
      isBack ? `${fixed(ago, 1)} s ago` : "now",
      -(ago ?? 0),
    );
  }

  // A recording.

  /** @param {string} name */
  _showRecording(name) {
    setText(this._word, "RECORDING");
    this._play = iconButton("play", "Play (K)", () => this._toggle());
    this._play.button.append(icon("pause"));
    this._speed = el(
      "select",
      { "aria-label": "Speed of the recording" },
      ...SPEEDS.map((each) => el("option", { value: each, selected: each === 1 }, `${each}x`)),
    );
    this._speed.addEventListener("change", () => {
      if (this._cursor.playing) this._link.send({ t: "play", speed: Number(this._speed?.value) });
    });
    this._rail = new Rail(
      "Time in the recording",
      (share) => this._timeline && this._seek(share * this._timeline.duration_s),
      (step) => this._seek(Math.max(0, this._cursor.t_s + step)),
    );
    setAttribute(this._rail.slider, "aria-valuemin", 0);
    this._note = el("input", {
      type: "text",
      maxlength: NOTE_LENGTH,
      hidden: true,
      placeholder: "note, then Enter",
      "aria-label": "Mark this time with a note",
    });
    this._note.addEventListener("keydown", (event) => this._onNote(event));
    this._note.addEventListener("blur", () => this._openNote(false));
    this.element.append(
      this._word,
      this._play.element,
      iconButton("previous", "Previous event (P)", () => this._jump(-1), "more").element,
      iconButton("next", "Next event (N)", () => this._jump(1), "more").element,
      el("span.name", { title: name }, name),
      this._rail.element,
      el("span.row.more", this._time, this._speed),
      this._note,
      iconButton("mark", "Mark (B)", () => this._openNote(true), "more").element,
      this._list.button.element,
      new Button("Live", () => goTo(null), { kind: "quiet", tip: "Key L" }).element,
      iconButton("more", "More of the timeline", () => this._unfold(), "unfold").element,
    );
    this._list.button.element.classList.add("more");
    this.element.hidden = false;
    this._list.fill();
    this._link.on("timeline", (timeline) => this._fill(timeline));
    this._link.on("cursor", (cursor) => this._draw(cursor));
  }

  /** @param {Timeline} timeline */
  _fill(timeline) {
    const events = [...timeline.events].sort((one, other) => one.t_s - other.t_s);
    this._timeline = { ...timeline, events };
    const signs = events.map((event) =>
      el(
        "button.happened",
        {
          type: "button",
          tabindex: -1,
          title: `${fixed(event.t_s, 1)} s ${event.kind}: ${event.text}`,
          "data-kind": event.kind,
          style: `left: ${(100 * event.t_s) / timeline.duration_s}%`,
          onclick: () => this._seek(event.t_s),
        },
        SIGNS[event.kind] ?? "•",
      ),
    );
    this._rail?.fill(signs);
    if (this._rail) setAttribute(this._rail.slider, "aria-valuemax", timeline.duration_s);
    this._draw(this._cursor);
  }

  /** @param {Cursor} cursor */
  _draw(cursor) {
    this._cursor = cursor;
    if (this._timeline === null) return;
    const { start_ms: start, duration_s: duration } = this._timeline;
    const time = new Date(start + 1000 * cursor.t_s).toLocaleTimeString([], { hour12: false });
    const text = `${time} · ${fixed(cursor.t_s, 1)} s`;
    this._rail?.draw(cursor.t_s / duration, text, cursor.t_s);
    setText(this._time, text);
    if (this._play) name(this._play, cursor.playing ? "Pause (K)" : "Play (K)");
    this._play?.button.toggleAttribute("data-playing", cursor.playing);
  }

  _unfold() {
    this.element.toggleAttribute("data-open");
  }

  _toggle() {
    if (this._cursor.playing) this._link.send({ t: "pause" });
    else this._link.send({ t: "play", speed: Number(this._speed?.value) });
  }

  /** @param {number} t_s */
  _seek(t_s) {
    this._throttle.send({ t: "seek", t_s });
  }

  /** @param {1 | -1} direction */
  _jump(direction) {
    const events = this._timeline?.events ?? [];
    const t_s = this._cursor.t_s;
    const next =
      direction > 0
        ? events.find((each) => each.t_s > t_s + NEAR_S)
        : events.findLast((each) => each.t_s < t_s - NEAR_S);
    if (next !== undefined) this._seek(next.t_s);
  }

  /** @param {boolean} opens */
  _openNote(opens) {
    if (!this._note) return;
    if (opens) this.element.toggleAttribute("data-open", true);
    this._note.hidden = !opens;
    if (opens) this._note.focus();
  }

  /** @param {KeyboardEvent} event */
  _onNote(event) {
    const note = /** @type {HTMLInputElement} */ (this._note);
    if (event.key === "Enter" && note.value !== "") {
      this._link.send({ t: "mark", note: note.value });
      note.value = "";
      note.blur();
    } else if (event.key === "Escape") note.blur();
  }
}

/** List of recordings, each with a thumbnail of its path. */
class RecordingList {
  /** @param {string | null} shown */
  constructor(shown) {
    this._shown = shown;
    this.button = new Button("Recordings", () => this.toggle(!this.isOpen), { kind: "quiet" });
    setAttribute(this.button.button, "aria-expanded", "false");
    this.element = el("div.recordings.surface", {
      hidden: true,
      role: "group",
      "aria-label": "Recordings",
    });
  }

  get isOpen() {
    return !this.element.hidden;
  }

  /** @param {boolean} opens */
  toggle(opens) {
    this.element.hidden = !opens;
    setAttribute(this.button.button, "aria-expanded", String(opens));
    if (opens) this.fill();
    else this.button.button.focus();
  }

  /** Refresh the list; return whether the server has recordings. */
  async fill() {
    const answer = await fetch("recordings").catch(() => undefined);
    if (answer?.status !== 200) return false;
    /** @type {RecordingName[]} */
    const found = await answer.json();
    const lines = found.map((each) => this._line(each));
    this.element.replaceChildren(...(lines.length > 0 ? lines : ["There are no recordings yet."]));
    return true;
  }

  /** @param {RecordingName} recording */
  _line(recording) {
    const { name, start_ms: start, duration_s: length, robots, marks, is_whole: whole } = recording;
    const picture = svg("svg.picture", {
      viewBox: `0 0 ${PICTURE.width} ${PICTURE.height}`,
      "aria-hidden": "true",
    });
    if (this.isOpen) drawPaths(picture, name);
    const minutes = length < 60 ? `${fixed(length, 0)} s` : `${fixed(length / 60, 1)} min`;
    const notes = [robots.join(", "), marks > 0 ? `${marks} ◆` : "", whole ? "" : "being recorded"];
    return el(
      "button.recording",
      {
        type: "button",
        title: name,
        "aria-current": name === this._shown ? "true" : null,
        onclick: () => goTo(name),
      },
      picture,
      el(
        "span",
        el("b", `${new Date(start).toLocaleString()} · ${minutes}`),
        el("span.muted", notes.filter(Boolean).join(" · ")),
      ),
    );
  }
}

/** @param {SVGElement} picture @param {string} name */
async function drawPaths(picture, name) {
  const answer = await fetch(`recordings/${encodeURIComponent(name)}/path`).catch(() => undefined);
  if (answer?.status !== 200) return;
  /** @type {RecordedPath[]} */
  const paths = await answer.json();
  const every = paths.flatMap(({ points }) => points);
  if (every.length === 0) return;
  // As on the map: x is up, y is left.
  const across = every.map(([, y]) => -y);
  const down = every.map(([x]) => -x);
  const [left, top] = [Math.min(...across), Math.min(...down)];
  const wide = Math.max(Math.max(...across) - left, 0.5);
  const high = Math.max(Math.max(...down) - top, 0.5);
  const { width, height, margin } = PICTURE;
  const scale = Math.min((width - 2 * margin) / wide, (height - 2 * margin) / high);
  const place = (
    /** @type {number} */ value,
    /** @type {number} */ low,
    /** @type {number} */ room,
  ) => fixed((value - low) * scale + room, 1);
  const aside = (width - (Math.max(...across) - left) * scale) / 2;
  const above = (height - (Math.max(...down) - top) * scale) / 2;
  for (const { colour, points } of paths) {
    const line = points.map(([x, y]) => `${place(-y, left, aside)},${place(-x, top, above)}`);
    picture.append(svg("polyline", { points: line.join(" "), stroke: colour }));
    const [x, y] = points.at(-1) ?? [0, 0];
    picture.append(
      svg("circle", {
        cx: place(-y, left, aside),
        cy: place(-x, top, above),
        r: 2.5,
        fill: colour,
      }),
    );
  }
}

/** @param {string} shape @param {string} tip With its key. @param {() => void} press */
function iconButton(shape, tip, press, kind = "") {
  const button = new Button("", press, { kind: "quiet", tip });
  if (kind !== "") button.element.classList.add(kind);
  button.button.prepend(icon(shape));
  name(button, tip);
  return button;
}

/** @param {Button} button @param {string} tip */
function name(button, tip) {
  button.setLabel("", tip);
  setAttribute(button.button, "aria-label", tip.replace(/ \(.\)$/, ""));
}

/** @param {PastState} past @param {number | null} speed */
function told({ mode }, speed) {
  return speed === null ? mode : `${mode}, ${fixed(speed, 2)} m/s`;
}

/** Reload this page for a recording or for the live robots. @param {string | null} recording */
function goTo(recording) {
  const address = new URL(location.href);
  if (recording === null) address.searchParams.delete("recording");
  else address.searchParams.set("recording", recording);
  location.assign(address);
}
