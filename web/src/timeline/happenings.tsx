// Events on a lane: an icon and a label each, merged into a count where they would overlap.

import { useEffect, useRef, useState } from "preact/hooks";
import type { RobotEvent, TimelineEvent } from "../generated/wire";
import { sentence } from "../text/reasons";
import { texts } from "../text/text";
import { Icon, type IconName } from "../ui/icon";
import { grouped, textPx } from "./groups";

const ICON_PX = 20;
const LABEL_PX = 190; // Longer labels are cut off; their title has all of it.
const ICONS: Record<string, IconName> = {
  fault: "warn",
  stop: "stopsign",
  drop: "link",
  consistency: "half",
  "hand-over": "wheel",
  mark: "flag",
}; // The first of a group gives the icon.
const SEVERITY = Object.keys(ICONS);

export interface Happening {
  /** Share of the lane. */
  at: number;
  kind: string;
  label: string;
  /** The whole text, with its time. */
  title: string;
}

/** Kind of a live event as in recordings, or null if it is not shown. */
export function kindOf({ kind, why }: RobotEvent): string | null {
  const after = why.params?.["after"];
  if (kind === "mode" && after === "fault") return "fault";
  if (kind === "mode") return after === "stopped" || after === "stopping" ? "stop" : null;
  return { drop: "drop", lease: "hand-over", consistency: "consistency" }[kind] ?? null;
}

/** Text of a recorded event; notes and old events have no reason. */
export function textOf({ why, text, kind }: TimelineEvent): string {
  return why ? sentence(why) : text || (texts().timeline.kinds[kind] ?? kind);
}

/** A few words for a label: the cause of a stop rather than the change of the mode. */
export function labelOf(event: TimelineEvent): string {
  const why = event.why?.cause ?? event.why;
  const label = why ? sentence(why).slice(0, -1) : textOf(event);
  return event.count > 1 ? `${label} × ${event.count}` : label;
}

/** Width of an element in px, 0 before it is known. */
export function useWidth<T extends Element>() {
  const ref = useRef<T>(null);
  const [width, setWidth] = useState(0);
  useEffect(() => {
    if (ref.current === null) return undefined;
    const observer = new ResizeObserver(([entry]) => setWidth(entry?.contentRect.width ?? 0));
    observer.observe(ref.current);
    return () => observer.disconnect();
  }, []);
  return [ref, width] as const;
}

interface HappeningsProps<T> {
  /** In order of time. */
  list: readonly T[];
  roomPx: number;
  labels?: boolean;
  onChoose: (first: T) => void;
}

export function Happenings<T extends Happening>(props: HappeningsProps<T>) {
  const { list, roomPx, labels = false, onChoose } = props;
  const text = (items: readonly T[]) =>
    items.length > 1
      ? labels
        ? texts().timeline.events(items.length)
        : `${items.length}`
      : items[0]!.label;
  const width = (items: readonly T[]) =>
    ICON_PX + (labels || items.length > 1 ? 4 + Math.min(LABEL_PX, textPx(text(items))) : 0);
  const groups = grouped(list, roomPx, ({ at }) => at * roomPx - ICON_PX / 2, width);
  return (
    <div class="happened">
      {groups.map(({ items, leftPx, widthPx }) => {
        const kinds = items.map(({ kind }) => kind);
        const kind = SEVERITY.find((each) => kinds.includes(each)) ?? "mark";
        const title = items
          .slice(0, 12)
          .map((each) => each.title)
          .join("\n");
        return (
          <button
            key={`${items[0]!.at} ${items[0]!.title}`}
            type="button"
            class={`event is-${kind}`}
            style={{ left: `${leftPx}px`, width: `${widthPx}px` }}
            tabIndex={-1}
            title={title}
            aria-label={
              items.length > 1 ? `${texts().timeline.events(items.length)}: ${title}` : title
            }
            onClick={() => onChoose(items[0]!)}
          >
            <Icon name={ICONS[kind]!} />
            {(labels || items.length > 1) && <bdi>{text(items)}</bdi>}
          </button>
        );
      })}
    </div>
  );
}
