// What both timelines share: a slider over a whole lane, its events, and buttons.

import type { ComponentChildren, TargetedPointerEvent } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon, type IconName } from "../ui/icon";
import { grouped, textPx } from "./groups";

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

/** Width of an element in px, 0 before it is known. */
export function useWidth() {
  const ref = useRef<HTMLDivElement>(null);
  const [width, setWidth] = useState(0);
  useEffect(() => {
    const observer = new ResizeObserver(([entry]) => setWidth(entry?.contentRect.width ?? 0));
    observer.observe(ref.current!);
    return () => observer.disconnect();
  }, []);
  return [ref, width] as const;
}

const ICON_PX = 20;
const LABEL_PX = 190; // Longer labels are cut off; their title has all of it.
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
  const [ref, roomPx] = useWidth();
  const { events } = texts().timeline;
  const text = ([first, ...more]: readonly Happening[]) =>
    more.length > 0 ? events(more.length + 1) : first!.label;
  const labelPx = (items: readonly Happening[]) => {
    const px = Math.min(LABEL_PX, textPx(text(items)));
    return px > 0 ? ICON_PX + 4 + px : ICON_PX;
  };
  const groups = grouped(list, roomPx, ({ share }) => share * roomPx - ICON_PX / 2, labelPx);
  return (
    <div class="happened" ref={ref}>
      {groups.map(({ items, leftPx, widthPx }) => {
        const { atS, title } = items[0]!;
        const has = (kind: string) => items.some((item) => item.kind === kind);
        const kind = Object.keys(ICONS).find(has) ?? "mark";
        return (
          <button
            key={`${atS} ${title}`}
            type="button"
            class={`event is-${kind}`}
            style={{ left: `${leftPx}px`, width: `${widthPx}px` }}
            tabIndex={-1}
            title={items
              .slice(0, TOLD)
              .map((each) => each.title)
              .join("\n")}
            onClick={() => onSeek(atS)}
          >
            <Icon name={ICONS[kind]!} />
            <bdi>{text(items)}</bdi>
          </button>
        );
      })}
    </div>
  );
}

interface WordButtonProps {
  icon: IconName;
  text: string;
  onPress: () => void;
}

/** Button whose word is hidden on a phone. */
export function WordButton({ icon, text, onPress }: WordButtonProps) {
  return (
    <Button icon={icon} label={text} onPress={onPress}>
      <span class="word">{text}</span>
    </Button>
  );
}
