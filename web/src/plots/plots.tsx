// Plots: fields over time in panes that share one axis, with pause, cursor, layouts and CSV.

import { effect, signal, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { type Session, useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Menu } from "../ui/menu";
import { type PlotChart } from "./chart";
import { Chooser } from "./chooser";
import { copyText, saveText } from "./export";
import { keys, listen } from "./gestures";
import { decode, encode } from "./layout";
import { DropPane, Pane } from "./pane";
import { PlotView } from "./view";
import "./plots.css";

const FRAME_MS = 100;
const SLOWEST_FRAME_MS = 500;
const WINDOWS_S = [20, 60, 120, 300, 600];

/** State shared by the parts of the tab. */
export interface Shared {
  view: PlotView;
  charts: Set<PlotChart>;
  /** Counts drawn pictures: values beside them follow it. */
  frame: { value: number };
  /** Name of the field that is dragged. */
  dragged: { value: string | null };
  redraw: () => void;
}

/** Plots of the selected robot; open or not, the session's recorder records. */
export function Plots() {
  const session = useSession();
  const { recorder } = session;
  const area = useRef<HTMLDivElement>(null);
  const shared = useMemo(() => share(session, area), [session]);
  const open = useSignal(false);
  const { layout, known } = recorder;
  const panes = layout.value.panes
    .map((names) => names.flatMap((name) => known.value.get(name) ?? []))
    .map((fields, i) => ({ fields, i }))
    .filter(({ fields }) => fields.length > 0);
  useEffect(() => follow(session, shared, area), [session]);
  useEffect(() => shared.redraw());
  return (
    <section class="plots" aria-label={texts().plots.title}>
      <Tools shared={shared} open={open} />
      {open.value && <Chooser shared={shared} />}
      <Area shared={shared} place={area}>
        {panes.map(({ fields, i }) => (
          <Pane
            key={`${recorder.robot?.id} ${i} ${fields.map(({ name }) => name).join()}`}
            shared={shared}
            fields={fields}
            at={i}
            isLast={i === panes.at(-1)?.i}
          />
        ))}
      </Area>
      <DropPane shared={shared} />
      {panes.length === 0 && <p class="note">{texts().plots.empty}</p>}
    </section>
  );
}

function share({ recorder, link }: Session, area: { current: HTMLElement | null }): Shared {
  const view = new PlotView(recorder, link);
  const charts = new Set<PlotChart>();
  const frame = signal(0);
  let asked = 0;
  const draw = () => {
    asked = 0;
    if (!area.current?.clientWidth) return;
    for (const chart of charts) chart.draw();
    frame.value += 1;
  };
  // Several inputs before a picture lead to one.
  const redraw = () => void (asked ||= requestAnimationFrame(draw));
  return { view, charts, frame, dragged: signal<string | null>(null), redraw };
}

/** Draw after a shift by a pixel, at most ten times a second, and after changes of the view. */
function follow(session: Session, shared: Shared, area: { current: HTMLElement | null }) {
  const { recorder, link } = session;
  const { view, redraw } = shared;
  let [drawnMs, generation, width] = [-Infinity, -1, 0];
  const beat = effect(() => {
    void link.beat.value;
    const now = area.current?.clientWidth ?? 0;
    if (generation !== recorder.buffer.generation) view.endS.value = null; // Different clock.
    const isOther = generation !== recorder.buffer.generation || width !== now;
    [generation, width] = [recorder.buffer.generation, now];
    const pixelMs = (1000 * recorder.layout.peek().windowS) / Math.max(1, now);
    const waitMs = Math.min(SLOWEST_FRAME_MS, pixelMs) - FRAME_MS / 2;
    const isDue = view.endS.peek() === null && performance.now() - drawnMs >= waitMs;
    if (!isOther && !isDue) return;
    drawnMs = performance.now();
    redraw();
  });
  const changes = effect(() => {
    void [view.endS.value, recorder.layout.value, session.view.dark.value];
    redraw();
  });
  return () => (beat(), changes());
}

function Tools({ shared, open }: { shared: Shared; open: { value: boolean } }) {
  const { recorder, link, notice } = useSession();
  const { view } = shared;
  const words = texts().plots;
  const { windowS } = recorder.layout.value;
  const paused = view.endS.value !== null;
  const copyLink = () => {
    const address = new URL(location.href);
    address.searchParams.set("plots", encode(recorder.layout.peek()));
    void copyText(address.href).then((ok) => notice.say(ok ? words.copied : words.notCopied));
  };
  const saveCsv = () => {
    const text = recorder.buffer.csv(recorder.fields, ...view.span());
    saveText(text, `${recorder.robot?.id}-${Math.round(view.span()[1])}s.csv`);
  };
  return (
    <div class="tools">
      <select
        class="field"
        aria-label={words.window}
        value={WINDOWS_S.includes(windowS) ? windowS : ""}
        onChange={({ currentTarget }) => view.setWindow(Number(currentTarget.value))}
      >
        <option hidden value="" />
        {WINDOWS_S.map((seconds) => (
          <option key={seconds} value={seconds}>
            {words.windows(seconds)}
          </option>
        ))}
      </select>
      {(link.recording === null || paused) && (
        <Button edge icon={paused ? "play" : "pause"} onPress={() => view.pause(!paused)}>
          {paused ? words.goOn : words.pause}
        </Button>
      )}
      <Button edge expanded={open.value} onPress={() => (open.value = !open.value)}>
        {words.fields}
      </Button>
      <span class="spacer" />
      <Layouts />
      <Button icon="share" label={words.copyLink} onPress={copyLink} />
      <Button icon="download" label={words.csv} onPress={saveCsv} />
    </div>
  );
}

/** Menu of the layouts that this browser has by name. */
function Layouts() {
  const { recorder } = useSession();
  const naming = useSignal(false);
  const name = useRef<HTMLInputElement>(null);
  const words = texts().plots;
  const saved = recorder.saved.value;
  const remove = (gone: string) => {
    const { [gone]: _, ...others } = saved;
    recorder.saved.value = others;
  };
  const save = (event: Event) => {
    event.preventDefault();
    const typed = name.current?.value.normalize("NFC").trim().slice(0, 40);
    if (typed) recorder.saved.value = { ...saved, [typed]: encode(recorder.layout.peek()) };
    naming.value = false;
  };
  useEffect(() => name.current?.focus(), [naming.value]);
  if (naming.value)
    return (
      <form class="field" onSubmit={save} onFocusOut={save}>
        <input ref={name} aria-label={words.nameOfLayout} placeholder={words.nameOfLayout} />
      </form>
    );
  const named = Object.keys(saved).sort((a, b) => a.localeCompare(b));
  const items = [
    ...named.map((each) => ({
      text: <bdi>{each}</bdi>,
      onChoose: () => recorder.choose(decode(saved[each])),
    })),
    { text: words.usual, onChoose: () => recorder.choose(null) },
    { text: words.saveAs, onChoose: () => (naming.value = true) },
    ...named.map((each) => ({ text: words.remove(each), onChoose: () => remove(each) })),
  ];
  return <Menu label={words.layouts} button={words.layouts} items={items} class="layouts" />;
}

interface AreaProps {
  shared: Shared;
  place: { current: HTMLDivElement | null };
  children: preact.ComponentChildren;
}

/** The panes: wheel zooms, drag pans, two fingers zoom, a click seeks in a recording. */
function Area({ shared, place, children }: AreaProps) {
  const { link } = useSession();
  const words = texts().plots;
  const isStale = useSignal(false);
  useEffect(
    () => effect(() => void (link.beat.value, (isStale.value = !isCurrent(freshness(link))))),
    [],
  );
  useEffect(() => listen(place.current!, shared), []);
  return (
    <div
      ref={place}
      class={isStale.value ? "charts stale" : "charts"}
      role="group"
      tabIndex={0}
      aria-label={words.title}
      aria-description={link.recording === null ? words.help : words.recordedHelp}
      onKeyDown={(event) => keys(event, shared)}
    >
      {children}
    </div>
  );
}
