// Plots: fields over time in panes that share one axis, with pause, cursor, layouts and CSV.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { useSession } from "../session";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import { focus, LineForm } from "../ui/line_form";
import { Menu } from "../ui/menu";
import { copyText, saveBlob } from "../ui/share";
import { decode, encode, homeOf, MAX_FIELDS } from "./layout";
import { dragOf, dropInto, Pane } from "./pane";
import type { Recorder } from "./recorder";
import { gesturesOf, PlotView } from "./view";
import "./plots.css";

const WINDOWS_S = [20, 60, 120, 300, 600];
const LONGEST_NAME = 40;

/** Plots of the selected robot; open or not, the session's recorder records. */
export function Plots() {
  const session = useSession();
  const { recorder, link } = session;
  const words = texts().plots;
  const area = useRef<HTMLDivElement>(null);
  const view = useMemo(() => new PlotView(recorder, link), [session]);
  const gestures = useMemo(() => gesturesOf(view), [view]);
  const isOpen = useSignal(false);
  const all = recorder.layout.value.panes;
  const panes = all
    .map((names, at) => ({
      at,
      fields: names.flatMap((name) => recorder.known.value.get(name) ?? []),
    }))
    .filter(({ fields }) => fields.length > 0);
  useEffect(() => view.follow(area.current!, session.view.dark), [view]);
  return (
    <section class="plots" aria-label={words.title}>
      <Tools view={view} isOpen={isOpen} />
      {isOpen.value && <Chooser view={view} />}
      <div
        ref={area}
        class={view.isStale.value ? "charts stale" : "charts"}
        role="group"
        tabIndex={0}
        aria-label={words.title}
        aria-description={link.recording === null ? words.help : words.recordedHelp}
        {...gestures}
      >
        {panes.map(({ at, fields }, i) => (
          <Pane
            key={[recorder.robot?.id, at, ...fields.map(({ name }) => name)].join()}
            view={view}
            fields={fields}
            at={at}
            isLast={i === panes.length - 1}
          />
        ))}
      </div>
      {view.dragged.value !== null && (
        <div class="drop" {...dropInto(view, all.length)}>
          {words.newPane}
        </div>
      )}
      {panes.length === 0 && <p class="note">{words.empty}</p>}
    </section>
  );
}

function Tools({ view, isOpen }: { view: PlotView; isOpen: Signal<boolean> }) {
  const { notice } = useSession();
  const words = texts().plots;
  const { recorder } = view;
  const { windowS } = recorder.layout.value;
  const isPaused = recorder.endS.value !== null;
  const copyLink = async () => {
    const address = new URL(location.href);
    address.searchParams.set("plots", encode(recorder.layout.peek()));
    notice.say((await copyText(address.href)) ? words.copied : words.notCopied);
  };
  const saveCsv = () => {
    const [fromS, toS] = view.span();
    const text = recorder.buffer.csv(recorder.fields, fromS, toS);
    const file = new Blob([text], { type: "text/csv" });
    saveBlob(file, `${recorder.robot?.id}-${Math.round(toS)}s.csv`);
  };
  return (
    <div class="tools">
      <select
        class="field"
        aria-label={words.window}
        value={WINDOWS_S.includes(windowS) ? windowS : ""}
        onChange={({ currentTarget }) => recorder.choose({ windowS: Number(currentTarget.value) })}
      >
        <option hidden value="" />
        {WINDOWS_S.map((seconds) => (
          <option key={seconds} value={seconds}>
            {words.windows(seconds)}
          </option>
        ))}
      </select>
      {(view.link.recording === null || isPaused) && (
        <Button
          edge
          icon={isPaused ? "play" : "pause"}
          onPress={() => view.end(isPaused ? null : view.span()[1])}
        >
          {isPaused ? words.goOn : words.pause}
        </Button>
      )}
      <Button edge expanded={isOpen.value} onPress={() => (isOpen.value = !isOpen.value)}>
        {words.fields}
      </Button>
      <span class="spacer" />
      <Layouts recorder={recorder} />
      <Button icon="share" label={words.copyLink} onPress={() => void copyLink()} />
      <Button icon="download" label={words.csv} onPress={saveCsv} />
    </div>
  );
}

/** Menu of the layouts that this browser has by name. */
function Layouts({ recorder }: { recorder: Recorder }) {
  const isNaming = useSignal(false);
  const { bar, plots: words } = texts();
  const { saved } = recorder;
  const remove = (name: string) => {
    const { [name]: _, ...others } = saved.peek();
    saved.value = others;
  };
  const save = (typed: string) => {
    const name = typed.normalize("NFC");
    if (name) saved.value = { ...saved.peek(), [name]: encode(recorder.layout.peek()) };
  };
  if (isNaming.value)
    return (
      <LineForm
        label={words.nameOfLayout}
        hint={words.nameOfLayout}
        most={LONGEST_NAME}
        action={bar.save}
        onSend={save}
        onClose={() => (isNaming.value = false)}
      />
    );
  const names = Object.keys(saved.value).sort((a, b) => a.localeCompare(b));
  const items = [
    ...names.map((name) => ({
      text: <bdi>{name}</bdi>,
      onChoose: () => recorder.choose(decode(saved.peek()[name])),
    })),
    { text: words.saveAs, onChoose: () => (isNaming.value = true) },
    ...names.map((name) => ({ text: words.remove(name), onChoose: () => remove(name) })),
  ];
  return <Menu label={words.layouts} button={words.layouts} items={items} class="layouts" />;
}

function Chooser({ view }: { view: PlotView }) {
  const { recorder } = view;
  const { known, layout, names } = recorder;
  const typed = useSignal("");
  const words = texts().plots;
  const parts = typed.value.toLowerCase().split(" ");
  const found = [...known.value.values()].filter(({ name, title }) => {
    const text = `${name} ${title} ${words.titles[title] ?? ""}`.toLowerCase();
    return parts.every((part) => text.includes(part));
  });
  return (
    <div class="chooser">
      <div class="field">
        <Icon name="search" />
        <input
          ref={focus}
          type="search"
          aria-label={words.find}
          placeholder={words.find}
          onInput={({ currentTarget }) => (typed.value = currentTarget.value)}
        />
        <Button onPress={() => recorder.choose(null)}>{words.usual}</Button>
      </div>
      <div class="list" role="group" aria-label={words.fields}>
        {found.map((field) => {
          const { name, unit } = field;
          const isChosen = names.includes(name);
          const isRefused = !isChosen && names.length >= MAX_FIELDS;
          const home = () => homeOf(layout.peek().panes, field, known.peek());
          return (
            // A button that Enter presses, because the space bar is STOP.
            <button
              key={name}
              type="button"
              class="btn"
              role="checkbox"
              aria-checked={isChosen}
              aria-disabled={isRefused || undefined}
              title={isRefused ? words.most(MAX_FIELDS) : undefined}
              onClick={() => isRefused || recorder.move(name, isChosen ? null : home())}
              {...dragOf(view, name)}
            >
              {isChosen ? <Icon name="ok" /> : <svg class="i" aria-hidden="true" />}
              {name}
              <span class="u">{unit}</span>
            </button>
          );
        })}
        {found.length === 0 && <p class="note">{words.noField}</p>}
      </div>
    </div>
  );
}
