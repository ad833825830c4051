// Timeline: live, or a recording that this page shows. A page shows one or the other: a recording has
// a scene and a session of its own on the server, in which nothing moves a robot but STOP.

import { Button } from "./button.js";
import { el, setText } from "./dom.js";
import { fixed } from "./format.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
const NEAR_S = 0.05;
/** @type {Record<string, number>} Seconds. */
const ARROWS = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10 };
const NOTE_LENGTH = 200;
const SIGNS = /** @type {Record<string, string>} */ ({
  stop: "■",
  drop: "↓",
  fault: "!",
  "hand-over": "⇄",
  consistency: "≠",
  mark: "◆",
});

export class TimelineBar {
  /** Marks `frame` when this page shows a recording. @param {Link} link @param {HTMLElement} frame */
  constructor(link, frame) {
    this._link = link;
    /** @type {Timeline | null} */
    this._timeline = null;
    /** @type {Cursor} */
    this._cursor = { t: "cursor", t_s: 0, playing: false, speed: 1 };
    this.recording = window.tsd.recording;
    this.element = el("section.timeline.surface", { "aria-label": "Timeline", hidden: true });
    frame.toggleAttribute("data-recording", this.recording !== null);
    if (this.recording === null) this._offer();
    else this._show(this.recording);
  }

  /** Take a key event; return whether it was for the timeline. @param {KeyboardEvent} event */
  key(event) {
    if (this.recording === null) return false;
    const act = this._keys[event.key.toLowerCase()];
    if (act === undefined) return false;
    if (event.type === "keydown") act();
    return true;
  }

  /** @type {Record<string, () => void>} */
  get _keys() {
    return {
      l: () => goTo(null),
      k: () => this._toggle(),
      n: () => this._jump(1),
      p: () => this._jump(-1),
      ".": () => this._send({ t: "step", back: false }),
      ",": () => this._send({ t: "step", back: true }),
      m: () => this._note?.focus(),
    };
  }

  /** Offer the recordings of the server, if it has any, below the live robots. */
  async _offer() {
    const answer = await fetch("recordings").catch(() => undefined);
    if (answer?.status !== 200) return;
    const menu = el("select", { "aria-label": "Recording" }, el("option", { value: "" }, "LIVE"));
    const fill = (/** @type {RecordingName[]} */ found) =>
      menu.replaceChildren(
        el("option", { value: "" }, "LIVE"),
        ...found.map((each) => el("option", { value: each.name }, titleOf(each))),
      );
    fill(await answer.json());
    menu.addEventListener("focus", async () => {
      const newest = await fetch("recordings").catch(() => undefined);
      if (newest?.status === 200 && menu.value === "") fill(await newest.json());
    });
    menu.addEventListener("change", () => menu.value !== "" && goTo(menu.value));
    this.element.append(el("span", "Recordings"), menu);
    this.element.hidden = false;
  }

  /** @param {string} name */
  _show(name) {
    this._play = new Button("Play", () => this._toggle(), { kind: "quiet" });
    this._speed = el(
      "select",
      { "aria-label": "Speed of the recording" },
      ...SPEEDS.map((each) => el("option", { value: each, selected: each === 1 }, `${each}x`)),
    );
    this._speed.addEventListener("change", () => {
      if (this._cursor.playing) this._send({ t: "play", speed: Number(this._speed?.value) });
    });
    this._place = el("div.place", {
      role: "slider",
      tabindex: 0,
      "aria-label": "Time in the recording",
      "aria-valuemin": 0,
    });
    this._mark = el("i.cursor");
    this._time = el("span.time.number", { role: "status", "aria-label": "Time" });
    this._note = el("input", {
      type: "text",
      maxlength: NOTE_LENGTH,
      placeholder: "note, then Enter (M)",
      "aria-label": "Mark this time with a note",
    });
    this._note.addEventListener("keydown", (event) => this._onNote(event));
    this._place.addEventListener("pointerdown", (event) => this._scrub(event, true));
    this._place.addEventListener("keydown", (event) => this._onArrow(event));
    this._place.addEventListener("pointermove", (event) => this._scrub(event, false));
    this.element.append(
      el("span.word", "RECORDING"),
      el("span", name),
      new Button("Previous event", () => this._jump(-1), { kind: "quiet" }).element,
      this._play.element,
      new Button("Next event", () => this._jump(1), { kind: "quiet" }).element,
      this._speed,
      this._place,
      this._time,
      this._note,
      new Button("Live", () => goTo(null), { kind: "quiet" }).element,
    );
    this.element.hidden = false;
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
          style: `left: ${(100 * event.t_s) / timeline.duration_s}%`,
          onclick: () => this._send({ t: "seek", t_s: event.t_s }),
        },
        SIGNS[event.kind] ?? "•",
      ),
    );
    this._place?.replaceChildren(el("i.rail"), ...signs, /** @type {Element} */ (this._mark));
    this._place?.setAttribute("aria-valuemax", String(timeline.duration_s));
    this._draw(this._cursor);
  }

  /** @param {Cursor} cursor */
  _draw(cursor) {
    this._cursor = cursor;
    if (this._timeline === null || !this._mark || !this._time || !this._place) return;
    const { start_ms: start, duration_s: duration } = this._timeline;
    this._mark.style.left = `${(100 * cursor.t_s) / duration}%`;
    this._place.setAttribute("aria-valuenow", fixed(cursor.t_s, 2));
    const clock = new Date(start + 1000 * cursor.t_s).toLocaleTimeString([], { hour12: false });
    setText(this._time, `${clock} · ${fixed(cursor.t_s, 1)} s`);
    this._play?.become(cursor.playing ? "Pause" : "Play", "Key K");
  }

  _toggle() {
    if (this._cursor.playing) this._send({ t: "pause" });
    else this._send({ t: "play", speed: Number(this._speed?.value) });
  }

  /** @param {1 | -1} direction */
  _jump(direction) {
    const events = this._timeline?.events ?? [];
    const t_s = this._cursor.t_s;
    const next =
      direction > 0
        ? events.find((each) => each.t_s > t_s + NEAR_S)
        : events.findLast((each) => each.t_s < t_s - NEAR_S);
    if (next !== undefined) this._send({ t: "seek", t_s: next.t_s });
  }

  /** @param {PointerEvent} event @param {boolean} begins */
  _scrub(event, begins) {
    const place = /** @type {HTMLElement} */ (this._place);
    if (this._timeline === null || event.target instanceof HTMLButtonElement) return;
    if (begins) place.setPointerCapture(event.pointerId);
    else if (!place.hasPointerCapture(event.pointerId)) return;
    const box = place.getBoundingClientRect();
    const share = Math.max(0, Math.min(1, (event.clientX - box.left) / box.width));
    this._send({ t: "seek", t_s: share * this._timeline.duration_s });
  }

  /** @param {KeyboardEvent} event */
  _onArrow(event) {
    const change = ARROWS[event.key];
    if (change === undefined) return;
    event.preventDefault();
    event.stopPropagation(); // Or the camera moves, too.
    this._send({ t: "seek", t_s: Math.max(0, this._cursor.t_s + change) });
  }

  /** @param {KeyboardEvent} event */
  _onNote(event) {
    const note = /** @type {HTMLInputElement} */ (this._note);
    if (event.key === "Enter" && note.value !== "") {
      this._send({ t: "mark", note: note.value });
      note.value = "";
      note.blur();
    } else if (event.key === "Escape") note.blur();
  }

  /** @param {TimelineRequest} message */
  _send(message) {
    this._link.send(message);
  }
}

/** @param {RecordingName} recording */
function titleOf({ start_ms: start, duration_s: duration, robots, marks, is_whole: whole }) {
  const minutes = duration < 60 ? `${fixed(duration, 0)} s` : `${fixed(duration / 60, 1)} min`;
  const notes = marks > 0 ? `, ${marks} ◆` : "";
  const growing = whole ? "" : ", being recorded";
  return `${new Date(start).toLocaleString()} · ${minutes} · ${robots.join(", ")}${notes}${growing}`;
}

/** Load this page anew, for a recording or for the live robots. @param {string | null} recording */
function goTo(recording) {
  const address = new URL(location.href);
  if (recording === null) address.searchParams.delete("recording");
  else address.searchParams.set("recording", recording);
  location.assign(address);
}
