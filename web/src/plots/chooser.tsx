// Selection of the plotted fields, with search.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { useSession } from "../session";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import type { PlotField } from "./fields";
import { homeOf, MAX_FIELDS, moved } from "./layout";
import { useDrag } from "./pane";
import type { Shared } from "./plots";

export function Chooser({ shared }: { shared: Shared }) {
  const { recorder } = useSession();
  const typed = useSignal("");
  const input = useRef<HTMLInputElement>(null);
  const words = texts().plots;
  useEffect(() => {
    recorder.search();
    input.current?.focus();
  }, []);
  const parts = typed.value.toLowerCase().split(" ");
  const found = [...recorder.known.value.values()].filter(({ name, title }) => {
    const text = `${name} ${title} ${words.titles[title] ?? ""}`.toLowerCase();
    return parts.every((part) => text.includes(part));
  });
  return (
    <div class="chooser">
      <div class="field">
        <Icon name="search" />
        <input
          ref={input}
          type="search"
          aria-label={words.find}
          placeholder={words.find}
          onInput={({ currentTarget }) => (typed.value = currentTarget.value)}
        />
        <Button onPress={() => recorder.choose(null)}>{words.usual}</Button>
      </div>
      <div class="list" role="group" aria-label={words.fields}>
        {found.map((field) => (
          <Choice key={field.name} shared={shared} field={field} />
        ))}
        {found.length === 0 && <p class="note">{words.noField}</p>}
      </div>
    </div>
  );
}

/** A button that Enter presses, because the space bar is STOP. */
function Choice({ shared, field }: { shared: Shared; field: PlotField }) {
  const { recorder } = useSession();
  const { known, layout, names } = recorder;
  const { name, unit } = field;
  const isChosen = names.includes(name);
  const refused = !isChosen && names.length >= MAX_FIELDS ? texts().plots.most(MAX_FIELDS) : null;
  const choose = () => {
    const { panes } = layout.peek();
    const to = isChosen ? null : homeOf(panes, field, known.peek());
    recorder.choose({ ...layout.peek(), panes: moved(panes, name, to) });
  };
  return (
    <button
      type="button"
      class="btn"
      role="checkbox"
      aria-checked={isChosen}
      aria-disabled={refused !== null || undefined}
      title={refused ?? undefined}
      onClick={() => refused === null && choose()}
      {...useDrag(shared, name)}
    >
      {isChosen ? <Icon name="ok" /> : <svg class="i" aria-hidden="true" />}
      {name}
      <span class="u">{unit}</span>
    </button>
  );
}
