// A recording in the list; the selected one has actions.

import { useState } from "preact/hooks";
import type { RecordedPath, RecordingRow, TrashRow } from "../generated/wire";
import { useSession } from "../session";
import { duration } from "../text/numbers";
import { nameOf } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { day, iso, megabytes } from "./clock";
import { Export } from "./export";
import { LineForm } from "./line_form";
import { openRecording, shared } from "./past";
import { type Result, titleOf } from "./recordings";
import { answer, request } from "./request";
import { playbackOf } from "./playback";

const TITLE_LENGTH = 40;

export interface RowProps {
  row: RecordingRow;
  /** Do something, and tell how it ended. */
  run: (work: () => Promise<Result | null>) => Promise<void>;
}

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
        <Facts row={row} />
      </button>
      {open && <Actions {...props} />}
    </li>
  );
}

function Facts({ row }: { row: RecordingRow }) {
  const { timeline } = texts();
  const { details, marks } = row;
  const [first] = details?.drivers ?? [];
  const many = (details?.drivers.length ?? 0) > 1;
  // Details of a file that grows are those of a moment ago.
  const facts = row.writing
    ? []
    : details
      ? [
          many ? timeline.drivers(details.drivers.length) : first ? nameOf(first) : timeline.nobody,
          timeline.stops(details.stops),
          details.faults > 0 && timeline.faults(details.faults),
        ]
      : [row.details_pending ? timeline.pending : timeline.unreadable];
  if (row.title !== "") facts.unshift(day(row.start_ms));
  if (marks > 0) facts.push(timeline.marks(marks));
  return (
    <span class="m">
      {[...facts, row.writing && timeline.writing, megabytes(row.size_bytes)]
        .filter(Boolean)
        .map((fact) => (
          <bdi key={fact}>{fact}</bdi>
        ))}
    </span>
  );
}

function Actions({ row, run }: RowProps) {
  const { link } = useSession();
  const { timeline } = texts();
  const [renaming, setRenaming] = useState(false);
  const [more, setMore] = useState(false);
  const file = encodeURIComponent(row.name);
  const download = async () => {
    await answer("HEAD", `${file}/download`); // A refusal becomes a sentence instead of a file.
    save(`recordings/${file}/download`, row.name);
    return null;
  };
  const share = async () => {
    const tS = row.name === link.recording ? playbackOf(link).cursor.peek().t_s : undefined;
    return { text: await shared(row.name, tS) };
  };
  const rename = (title: string) =>
    void run(async () => {
      await answer("PUT", `${file}/title`, { title });
      return null;
    });
  const remove = async () => {
    const undo = await request<TrashRow>("DELETE", file);
    return { text: `${timeline.deleted} ${titleOf(row)}`, undo };
  };
  return (
    <div class="actions">
      {renaming ? (
        <LineForm
          label={timeline.rename}
          hint={timeline.renameHint}
          most={TITLE_LENGTH}
          initial={row.title}
          onSend={rename}
          onClose={() => setRenaming(false)}
        />
      ) : (
        <div class="a">
          {row.name !== link.recording && (
            <Button edge icon="play" onPress={() => openRecording(row.name)}>
              {timeline.open}
            </Button>
          )}
          <Button icon="download" onPress={() => void run(download)}>
            {timeline.download}
          </Button>
          <Button icon="share" onPress={() => void run(share)}>
            {timeline.share}
          </Button>
          <Button icon="rename" onPress={() => setRenaming(true)}>
            {timeline.rename}
          </Button>
          <Button
            icon="more"
            label={timeline.moreActions}
            expanded={more}
            onPress={() => setMore(!more)}
          />
        </div>
      )}
      {more && (
        <>
          <Export row={row} run={run} />
          <Button
            refused={row.writing ? timeline.isWritten : null}
            onPress={() => void run(remove)}
          >
            {timeline.delete}
          </Button>
        </>
      )}
    </div>
  );
}

/** Let the browser save a file. */
export function save(address: string, name: string): void {
  const anchor = Object.assign(document.createElement("a"), { href: address, download: name });
  anchor.click();
}

const WIDE = 72;
const HIGH = 44;
const MARGIN = 4;
const LEAST_M = 0.5;

/** Paths of the robots, as on the map: x up, y left. */
function Preview({ paths }: { paths: readonly RecordedPath[] }) {
  const points = paths.flatMap((path) => path.points);
  const side = (values: readonly number[], px: number) => {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    return { middle: (low + high) / 2, scale: (px - 2 * MARGIN) / Math.max(LEAST_M, high - low) };
  };
  const across = side(
    points.map(([, y]) => -y),
    WIDE,
  );
  const down = side(
    points.map(([x]) => -x),
    HIGH,
  );
  const scale = Math.min(across.scale, down.scale);
  const place = ([x, y]: readonly [number, number]) => [
    (WIDE / 2 + (-y - across.middle) * scale).toFixed(1),
    (HIGH / 2 + (-x - down.middle) * scale).toFixed(1),
  ];
  return (
    <svg class="preview" viewBox={`0 0 ${WIDE} ${HIGH}`} aria-hidden="true">
      {paths.map(({ robot, colour, points: path }) => {
        const [x, y] = path.length > 0 ? place(path.at(-1)!) : [];
        return (
          <g key={robot} style={{ color: colour }}>
            <polyline points={path.map((point) => place(point).join()).join(" ")} />
            {x !== undefined && <circle cx={x} cy={y} r="2.5" />}
          </g>
        );
      })}
    </svg>
  );
}
