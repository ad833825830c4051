// What both timelines share: a slider over a whole lane, and its events.

import type { ComponentChildren, TargetedPointerEvent } from "preact";
import { useSession } from "../session";
import { texts } from "../text/text";
import { Icon, type IconName } from "../ui/icon";

const KEYS_S: Record<string, number> = {
  ArrowLeft: -1,
  ArrowDown: -1,
  ArrowRight: 1,
  ArrowUp: 1,
  PageDown: -10,
  PageUp: 10,
  Home: -Infinity,
  End: Infinity,
};

interface RailProps {
  label: string;
  /** Ends of the lane, and the time that is shown, in seconds. */
  fromS: number;
  toS: number;
  atS: number;
  /** The time that is shown in words. */
  text: string;
  onSeek: (atS: number) => void;
  children: ComponentChildren;
}

/** Slider over a whole lane, for pointer and keys; its children find the time at `--at`. */
export function Rail({ label, fromS, toS, atS, text, onSeek, children }: RailProps) {
  const point = (event: TargetedPointerEvent<HTMLElement>) => {
    const rail = event.currentTarget;
    if (!rail.hasPointerCapture(event.pointerId)) return;
    const { left, width } = rail.getBoundingClientRect();
    onSeek(fromS + (toS - fromS) * shareAt(event.clientX, left, width));
  };
  const press = (event: TargetedPointerEvent<HTMLElement>) => {
    if (event.button !== 0) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    point(event);
  };
  const key = (event: KeyboardEvent) => {
    const seconds = KEYS_S[event.code];
    if (seconds === undefined) return;
    event.preventDefault();
    onSeek(Math.max(fromS, Math.min(toS, atS + seconds)));
  };
  return (
    <div
      class="rail"
      role="slider"
      tabIndex={0}
      aria-label={label}
      aria-valuemin={fromS}
      aria-valuemax={toS}
      aria-valuenow={atS}
      aria-valuetext={text}
      style={{ "--at": `${100 * shareAt(atS, fromS, toS - fromS)}%` }}
      onPointerDown={press}
      onPointerMove={point}
      onKeyDown={key}
    >
      {children}
    </div>
  );
}

export function shareAt(x: number, start: number, length: number): number {
  return length > 0 ? Math.max(0, Math.min(1, (x - start) / length)) : 0;
}

/** Labels that are merged into one, and the room that they have as shares of the lane. */
export interface Group<T> {
  items: T[];
  left: number;
  width: number;
}

/**
 * Give each of some items, in order, at least a room of `least` to the right of its share of the
 * lane. Where the next one is nearer, or the lane ends, they are merged.
 */
export function grouped<T extends { share: number }>(items: readonly T[], least: number) {
  const groups: Group<T>[] = [];
  for (const item of items) {
    const left = Math.max(0, Math.min(item.share, 1 - least));
    const last = groups.at(-1);
    if (last && left - last.left < least) {
      last.items.push(item);
    } else {
      if (last) last.width = left - last.left;
      groups.push({ items: [item], left, width: 1 - left });
    }
  }
  return groups;
}

const TOLD = 12; // Events in the title of a group.
/** By severity: the first of a group gives its icon. */
const ICONS: Record<string, IconName> = {
  fault: "warn",
  stop: "stopsign",
  drop: "link",
  consistency: "half",
  "hand-over": "wheel",
  mark: "flag",
};

export interface Happening {
  atS: number;
  /** Share of the lane. */
  share: number;
  kind: string;
  /** A few words, or "" for the icon alone. */
  label: string;
  /** The whole text, with its time. */
  title: string;
}

interface HappeningsProps {
  /** In order of time. */
  list: readonly Happening[];
  onSeek: (atS: number) => void;
}

/** Events: an icon and a label each, merged into a count where they would overlap. */
export function Happenings({ list, onSeek }: HappeningsProps) {
  const { phone } = useSession().layout;
  return (
    <div class="happened">
      {grouped(list, phone.value ? 0.3 : 0.1).map(({ items, left, width }, i) => {
        const { atS, label } = items[0]!;
        const has = (kind: string) => items.some((item) => item.kind === kind);
        const kind = Object.keys(ICONS).find(has) ?? "mark";
        const titles = items.slice(0, TOLD).map((each) => each.title);
        return (
          <button
            key={i}
            type="button"
            class={`event is-${kind}`}
            style={{ left: `${100 * left}%`, maxWidth: `${100 * width}%` }}
            tabIndex={-1}
            title={titles.join("\n")}
            onClick={() => onSeek(atS)}
          >
            <Icon name={ICONS[kind]!} />
            <bdi>{items.length > 1 ? texts().timeline.events(items.length) : label}</bdi>
          </button>
        );
      })}
    </div>
  );
}
