// Which parts of the page are open, and the kind of window that they have to fit in.

import { computed, type Signal, signal } from "@preact/signals";
import { isFlag, isOneOf, remembered } from "./memory";

export const TABS = ["drive", "modules", "plots", "health", "view", "student"] as const;
export type Tab = (typeof TABS)[number];

const screenInAddress = () => (location.hash === "#fleet" ? "fleet" : "robot");
const SIDEWAYS = "(max-height: 599px) and (pointer: coarse) and (orientation: landscape)";

export function media(query: string): Signal<boolean> {
  const list = matchMedia(query);
  const matches = signal(list.matches);
  list.addEventListener("change", () => (matches.value = list.matches));
  return matches;
}

export class Layout {
  readonly tab = remembered<Tab>("tsd-tab", "drive", isOneOf(TABS));
  /** Whether the panel is folded away in a wide window. */
  readonly folded = remembered("tsd-folded", false, isFlag);
  /** Whether the panel is open as a drawer or, on a phone, as a sheet. */
  readonly drawerOpen = signal(false);
  /** Whether a wide window shows the sliders and the joints of the Drive tab side by side. */
  readonly beside = remembered("tsd-sliders-beside", false, isFlag);
  /** Class of tabs that need more room than a column, in windows from 1,280 px. */
  readonly panelWidth = computed(() => {
    const widths: Partial<Record<Tab, string>> = { plots: "wide", student: "wider" };
    return this.tab.value === "drive" && this.beside.value ? "wide" : widths[this.tab.value];
  });
  readonly dialog = signal<"sheet" | "name" | "takeover" | null>(null);
  readonly screen = signal<"robot" | "fleet">(screenInAddress());
  /** Below 900 px of width the panel is a drawer. */
  readonly narrow = media("(max-width: 899px)");
  /** Phone held sideways: the controls lie on the scene. */
  readonly sideways = media(SIDEWAYS);
  /** Phone held upright: bar, scene, figures, deck, tabs. */
  readonly phone = media(`(max-width: 599px) and (not (${SIDEWAYS}))`);
  readonly #isDrawer = computed(() => this.narrow.value || this.sideways.value);
  readonly panelOpen = computed(() =>
    this.#isDrawer.value ? this.drawerOpen.value : !this.folded.value,
  );

  constructor() {
    const query = new URL(location.href).searchParams;
    // A link to plots or to a setting of the Student tab shows them.
    for (const tab of ["plots", "student"] as const) if (query.has(tab)) this.open(tab);
    addEventListener("hashchange", () => (this.screen.value = screenInAddress()));
  }

  open(tab: Tab): void {
    this.tab.value = tab;
    this.folded.value = false;
    this.drawerOpen.value = true;
  }

  fold(): void {
    if (this.#isDrawer.peek()) this.drawerOpen.value = false;
    else this.folded.value = true;
  }
}
