// The list of recordings, over the scene; the deck stays free.

import { useState } from "preact/hooks";
import type { RecordingRow, TrashRow } from "../generated/wire";
import { useSession } from "../session";
import { nameOf } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";
import { Fold } from "../ui/fold";
import { Icon } from "../ui/icon";
import { day, megabytes } from "./clock";
import { type Library, recordingsOpen } from "./library";
import { Row } from "./row";
import { answer, problem } from "./request";

const SHOWN = 40; // Rows drawn at first, of a list that may have hundreds.
const QUERY_LENGTH = 100;

/** What happened to a request, and whether it can be undone. */
export interface Result {
  text: string;
  undo?: TrashRow;
}

export function Recordings({ library }: { library: Library }) {
  const { link } = useSession();
  const { timeline, common } = texts();
  const [selected, select] = useState(link.recording);
  const [shown, show] = useState(SHOWN);
  const [result, setResult] = useState<Result | null>(null);
  const rows = library.rows.value;
  /** Do something, and tell how it ended. */
  const run = async (work: () => Promise<Result | null>) => {
    setResult(null);
    try {
      setResult(await work());
    } catch (error) {
      setResult({ text: problem(error) });
    }
    library.refresh();
  };
  const restore = (row: TrashRow) =>
    void run(async () => {
      await answer("POST", `trash/${encodeURIComponent(row.id)}/restore`);
      select(row.name);
      return null;
    });
  return (
    <Dialog title={timeline.recordings} onClose={() => (recordingsOpen.value = false)}>
      <label class="field">
        <Icon name="search" />
        <input
          type="search"
          maxLength={QUERY_LENGTH}
          placeholder={timeline.searchHint}
          aria-label={common.search}
          value={library.query.value}
          onInput={(event) => library.search(event.currentTarget.value)}
        />
      </label>
      <div class="result" role="status">
        {result && <bdi>{result.text}</bdi>}
        {result?.undo && <Button onPress={() => restore(result.undo!)}>{timeline.undo}</Button>}
      </div>
      <Listed library={library} />
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
      {library.trash.value.length > 0 && <Trash rows={library.trash.value} onRestore={restore} />}
    </Dialog>
  );
}

/** Why there is no list. */
function Listed({ library }: { library: Library }) {
  const { timeline } = texts();
  const state = library.state.value;
  if (state === "ready" && library.rows.value.length > 0) return null;
  const text = state !== "ready" ? state : library.query.value.trim() === "" ? "empty" : "noMatch";
  return (
    <p class="note">
      {timeline.list[text]}
      {state === "failed" && <Button onPress={() => library.refresh()}>{timeline.again}</Button>}
    </p>
  );
}

function Trash({
  rows,
  onRestore,
}: {
  rows: readonly TrashRow[];
  onRestore: (row: TrashRow) => void;
}) {
  const { timeline } = texts();
  return (
    <Fold title={timeline.trash} summary={String(rows.length)}>
      <ul class="recs">
        {rows.map((row) => (
          <li key={row.id} class="trashed">
            <bdi>{row.title || row.name}</bdi>
            <span class="note">
              {day(row.deleted_ms)}, <bdi>{timeline.by(nameOf(row.by))}</bdi>,{" "}
              {megabytes(row.size_bytes)}
            </span>
            <Button onPress={() => onRestore(row)}>{timeline.restore}</Button>
          </li>
        ))}
      </ul>
    </Fold>
  );
}

/** Title of a recording, or when it was made. */
export const titleOf = (row: RecordingRow): string => row.title || day(row.start_ms);
