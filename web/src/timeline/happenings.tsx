// Events on a lane, merged into a count where their labels would overlap.

import { useSession } from "../session";
import { texts } from "../text/text";
import { Icon, type IconName } from "../ui/icon";

/**
 * Merge items, given in order, that are closer than `least`, a fraction of the lane. The last one
 * moves left to keep that distance from the end. Returns groups with place and width as fractions.
 */
export function grouped<T extends { share: number }>(items: readonly T[], least: number) {
  const groups: { items: T[]; left: number; width: number }[] = [];
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
  /** Fraction of the lane. */
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

export function Happenings({ list, onSeek }: HappeningsProps) {
  const { phone } = useSession().layout;
  const isLabelled = list.some(({ label }) => label !== "");
  const least = isLabelled ? 0.1 : 0.03;
  return (
    <div class="happened">
      {grouped(list, phone.value ? 3 * least : least).map(({ items, left, width }, i) => {
        const { atS, label } = items[0]!;
        const has = (kind: string) => items.some((item) => item.kind === kind);
        const kind = Object.keys(ICONS).find(has) ?? "mark";
        const count = isLabelled ? texts().timeline.events(items.length) : items.length;
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
            <bdi>{items.length > 1 ? count : label || null}</bdi>
          </button>
        );
      })}
    </div>
  );
}
