// The list of recordings, over the scene; the deck stays free.

import { useState } from "preact/hooks";
import type { TrashRow } from "../generated/wire";
import { useSession } from "../session";
import { nameOf } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";
import { Fold } from "../ui/fold";
import { Icon } from "../ui/icon";
import { day, megabytes } from "./clock";
import { answer } from "./library";
import { type Result, Row, type RowProps } from "./row";

const SHOWN = 40; // Rows drawn at first; the list may have hundreds.
const QUERY_LENGTH = 100;

export function Recordings() {
  const { library, link } = useSession();
  const { timeline, common } = texts();
  const [selected, select] = useState(link.recording);
  const [shown, show] = useState(SHOWN);
  const [result, setResult] = useState<Result | null>(null);
  const { rows, trash, state } = library.list.value;
  const isSearch = library.query.value.trim() !== "";
  const empty = state !== "ready" ? state : rows.length > 0 ? null : isSearch ? "noMatch" : "empty";
  const run: RowProps["run"] = (work, meanwhile = "") => {
    setResult(meanwhile === "" ? null : { text: meanwhile });
    void work()
      .catch((error: Error) => ({ text: error.message }))
      .then((ended) => setResult(ended ?? null))
      .then(() => library.refresh());
  };
  const restore = (row: TrashRow) =>
    run(async () => {
      await answer("POST", `recordings/trash/${encodeURIComponent(row.id)}/restore`);
      select(row.name);
    });
  return (
    <Dialog title={timeline.recordings} onClose={() => (library.open.value = false)}>
      <label class="field">
        <Icon name="search" />
        <input
          type="search"
          maxLength={QUERY_LENGTH}
          placeholder={timeline.searchHint}
          aria-label={common.search}
          value={library.query.value}
          onInput={(event) => (library.query.value = event.currentTarget.value)}
        />
      </label>
      <div class="result" role="status">
        {result && <bdi>{result.text}</bdi>}
        {result?.undo && <Button onPress={() => restore(result.undo!)}>{timeline.undo}</Button>}
      </div>
      {empty && (
        <p class="note">
          {timeline.list[empty]}
          {empty === "failed" && (
            <Button onPress={() => library.refresh()}>{timeline.again}</Button>
          )}
        </p>
      )}
      <ul class="recs">
        {rows.slice(0, shown).map((row) => (
          <Row
            key={row.name}
            row={row}
            open={row.name === selected}
            onSelect={() => select(row.name === selected ? null : row.name)}
            run={run}
          />
        ))}
      </ul>
      {rows.length > shown && (
        <Button edge onPress={() => show(shown + 4 * SHOWN)}>
          {timeline.more(rows.length - shown)}
        </Button>
      )}
      {trash.length > 0 && (
        <Fold title={timeline.trash} summary={String(trash.length)}>
          <ul class="recs">
            {trash.map((row) => (
              <li key={row.id} class="trashed">
                <bdi>{row.title || row.name}</bdi>
                <span class="note">
                  {day(row.deleted_ms)}, <bdi>{timeline.by(nameOf(row.by))}</bdi>,{" "}
                  {megabytes(row.size_bytes)}
                </span>
                <Button onPress={() => restore(row)}>{timeline.restore}</Button>
              </li>
            ))}
          </ul>
        </Fold>
      )}
    </Dialog>
  );
}

/** Opens the list; on a phone, without its word. */
export function ListButton() {
  const { open } = useSession().library;
  const { recordings } = texts().timeline;
  return (
    <Button
      icon="search"
      label={recordings}
      expanded={open.value}
      onPress={() => (open.value = true)}
    >
      <span class="word">{recordings}</span>
    </Button>
  );
}
