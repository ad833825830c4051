// A recording in the list; the selected one has actions.

import { useState } from "preact/hooks";
import type { RecordedPath, RecordingRow, TrashRow } from "../generated/wire";
import { useSession } from "../session";
import { duration } from "../text/numbers";
import { nameOf } from "../text/reasons";
import { texts } from "../text/text";
import { Button, type ButtonProps } from "../ui/button";
import { day, iso, megabytes } from "./clock";
import { Export } from "./export";
import { answer, request } from "./library";
import { LineForm } from "./line_form";
import { addressOf, shared } from "./playback";

const TITLE_LENGTH = 40;

/** What happened to a request, and whether it can be undone. */
export interface Result {
  text: string;
  undo?: TrashRow;
}

export interface RowProps {
  row: RecordingRow;
  /** Do something, and tell how it ended; `meanwhile` is shown until then. */
  run: (work: () => Promise<Result | void>, meanwhile?: string) => void;
}

/** Title of a recording, or when it was made. */
export const titleOf = (row: RecordingRow): string => row.title || day(row.start_ms);

/** Path of the requests about a recording. */
export const pathOf = (row: RecordingRow): string => `recordings/${encodeURIComponent(row.name)}`;

export function Row({
  open,
  onSelect,
  ...props
}: RowProps & { open: boolean; onSelect: () => void }) {
  const { row } = props;
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
      {open && <Actions {...props} />}
    </li>
  );
}

function factsOf(row: RecordingRow): string[] {
  const { timeline } = texts();
  const { details, marks } = row;
  const facts: string[] = row.title === "" ? [] : [day(row.start_ms)];
  if (row.writing) {
    facts.push(timeline.writing); // Details of a file that grows are those of a moment ago.
  } else if (details === null) {
    facts.push(row.details_pending ? timeline.pending : timeline.unreadable);
  } else {
    const [first, ...others] = details.drivers;
    if (first === undefined) facts.push(timeline.nobody);
    else facts.push(others.length > 0 ? timeline.drivers(others.length + 1) : nameOf(first));
    facts.push(timeline.stops(details.stops));
    if (details.faults > 0) facts.push(timeline.faults(details.faults));
  }
  if (marks > 0) facts.push(timeline.marks(marks));
  return [...facts, megabytes(row.size_bytes)];
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

/** Let the browser save a file. */
export function save(href: string, download: string): void {
  Object.assign(document.createElement("a"), { href, download }).click();
}

const LEAST_M = 0.5;

/** Paths of the robots, as on the map: x up, y left. */
function Preview({ paths }: { paths: readonly RecordedPath[] }) {
  const points = paths.flatMap((path) => path.points);
  if (points.length === 0) return <svg class="preview" aria-hidden="true" />;
  const extent = (values: readonly number[]) => {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const length = Math.max(LEAST_M, high - low);
    return { start: (low + high - length) / 2, length };
  };
  const across = extent(points.map(([, y]) => -y));
  const down = extent(points.map(([x]) => -x));
  return (
    <svg
      class="preview"
      viewBox={[across.start, down.start, across.length, down.length].join(" ")}
      aria-hidden="true"
    >
      {paths.map((path) => (
        <g key={path.robot} style={{ color: path.colour }} transform="matrix(0 -1 -1 0 0 0)">
          <polyline points={path.points.join(" ")} />
          {path.points.length > 0 && <path d={`M${path.points.at(-1)} h0`} />}
        </g>
      ))}
    </svg>
  );
}
