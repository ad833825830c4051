// A recording in the list; the selected one has actions.

import { useState } from "preact/hooks";
import type { RecordedPath, RecordingRow, TrashRow } from "../generated/wire";
import { useSession } from "../session";
import { nameOf } from "../text/reasons";
import { duration, texts } from "../text/text";
import { Button, type ButtonProps } from "../ui/button";
import { LineForm } from "../ui/line_form";
import { save, saveBlob } from "../ui/share";
import { day, iso, megabytes } from "./clock";
import { addressOf, answer, request, shared } from "./library";

const TITLE_LENGTH = 40;

/** Result of a request, and whether it can be undone. */
export interface Result {
  text: string;
  undo?: TrashRow;
}

export interface RowProps {
  row: RecordingRow;
  /** Do something, and tell how it ended; `meanwhile` is shown until then. */
  run: (work: () => Promise<Result | void>, meanwhile?: string) => void;
}

const titleOf = (row: RecordingRow): string => row.title || day(row.start_ms);

const pathOf = (row: RecordingRow): string => `recordings/${encodeURIComponent(row.name)}`;

export function Row(props: RowProps & { open: boolean; onSelect: () => void }) {
  const { row, run, open, onSelect } = props;
  return (
    <li class={open ? "rec on" : "rec"}>
      <button type="button" class="pick" aria-expanded={open} onClick={onSelect}>
        <Preview paths={row.details?.paths ?? []} />
        <span class="h">
          <b>
            <bdi>{titleOf(row)}</bdi>
          </b>
          <time dateTime={iso(row.start_ms)} title={`${day(row.start_ms)}, ${iso(row.start_ms)}`}>
            {duration(row.duration_s)}
          </time>
        </span>
        <span class="m">
          {factsOf(row).map((fact) => (
            <bdi key={fact}>{fact}</bdi>
          ))}
        </span>
      </button>
      {open && <Actions row={row} run={run} />}
    </li>
  );
}

function factsOf(row: RecordingRow): string[] {
  const { timeline } = texts();
  const { drivers, stops, faults } = row.details ?? { drivers: [], stops: 0, faults: 0 };
  const driver = drivers[0] === undefined ? timeline.nobody : nameOf(drivers[0]);
  const unread =
    row.details === null && (row.details_pending ? timeline.pending : timeline.unreadable);
  // Details of a growing file are already outdated.
  const unknown = row.writing ? timeline.writing : unread;
  const facts = [
    row.title !== "" && day(row.start_ms),
    unknown || (drivers.length > 1 ? timeline.drivers(drivers.length) : driver),
    !unknown && timeline.stops(stops),
    !unknown && faults > 0 && timeline.faults(faults),
    row.marks > 0 && timeline.marks(row.marks),
    megabytes(row.size_bytes),
  ];
  return facts.filter((fact) => fact !== false);
}

function Actions({ row, run }: RowProps) {
  const { link, playback } = useSession();
  const { timeline } = texts();
  const [part, setPart] = useState<"rename" | "more" | null>(null);
  const isShown = row.name === link.recording;
  const download = async () => {
    await answer("HEAD", `${pathOf(row)}/download`); // A refusal becomes a sentence, not a file.
    save(`${pathOf(row)}/download`, row.name);
  };
  const share = async () => ({
    text: await shared(row.name, isShown ? playback.cursor.peek().t_s : undefined),
  });
  const rename = async (title: string) => {
    await answer("PUT", `${pathOf(row)}/title`, { title });
  };
  const remove = async () => {
    const undo = await request<TrashRow>("DELETE", pathOf(row));
    return { text: `${timeline.deleted} ${titleOf(row)}`, undo };
  };
  const buttons: ButtonProps[] = [
    { icon: "download", children: timeline.download, onPress: () => run(download) },
    { icon: "share", children: timeline.share, onPress: () => run(share) },
    { icon: "rename", children: timeline.rename, onPress: () => setPart("rename") },
  ];
  return (
    <div class="actions">
      {part === "rename" ? (
        <LineForm
          label={timeline.rename}
          hint={timeline.renameHint}
          most={TITLE_LENGTH}
          initial={row.title}
          onSend={(title) => run(() => rename(title))}
          onClose={() => setPart(null)}
        />
      ) : (
        <div class="a">
          {!isShown && (
            <Button edge icon="play" onPress={() => location.assign(addressOf(row.name))}>
              {timeline.open}
            </Button>
          )}
          {buttons.map((button) => (
            <Button key={button.icon} {...button} />
          ))}
          <Button
            icon="more"
            label={timeline.moreActions}
            expanded={part === "more"}
            onPress={() => setPart(part === "more" ? null : "more")}
          />
        </div>
      )}
      {part === "more" && (
        <>
          <Export row={row} run={run} />
          <Button refused={row.writing ? timeline.isWritten : null} onPress={() => run(remove)}>
            {timeline.delete}
          </Button>
        </>
      )}
    </div>
  );
}

const ENDINGS: Record<string, string> = { html: ".html", mcap: ".mcap", csv: ".zip" };

/** Export of all or a part. The dashboard makes it, which may take minutes. */
function Export({ row, run }: RowProps) {
  const { timeline } = texts();
  const make = async (query: URLSearchParams) => {
    const file = await answer("GET", `${pathOf(row)}/export?${query}`);
    const name = row.title || row.name.replace(/\.mcap$/, "");
    saveBlob(await file.blob(), name + ENDINGS[query.get("as")!]);
  };
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const form = new FormData(event.currentTarget as HTMLFormElement, event.submitter);
    const query = new URLSearchParams();
    form.forEach((value, name) => value !== "" && query.set(name, String(value)));
    run(() => make(query), timeline.exporting);
  };
  return (
    <form class="export" onSubmit={submit}>
      {timeline.exportAs}
      {Object.entries(timeline.exports).map(([kind, name]) => (
        <button key={kind} class="btn edge" name="as" value={kind}>
          {name}
        </button>
      ))}
      {(["from", "to"] as const).map((name) => (
        <label key={name} class="field">
          {timeline[name]}
          <input type="number" name={name} step="any" min="0" max={row.duration_s} /> s
        </label>
      ))}
    </form>
  );
}

const LEAST_M = 0.5;

/** Paths of the robots, as on the map: x up, y left. */
function Preview({ paths }: { paths: readonly RecordedPath[] }) {
  const points = paths.flatMap((path) => path.points);
  const extent = (values: readonly number[]) => {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const length = Math.max(LEAST_M, high - low);
    return { start: (low + high - length) / 2, length };
  };
  const [across, down] = [extent(points.map(([, y]) => -y)), extent(points.map(([x]) => -x))];
  const box = [across.start, down.start, across.length, down.length].join(" ");
  return (
    <svg class="preview" viewBox={points.length > 0 ? box : undefined} aria-hidden="true">
      {paths.map(({ robot, colour, points: path }) => (
        <g key={robot} style={{ color: colour }} transform="matrix(0 -1 -1 0 0 0)">
          <polyline points={path.join(" ")} />
          {path.length > 0 && <path d={`M${path.at(-1)} h0`} />}
        </g>
      ))}
    </svg>
  );
}
