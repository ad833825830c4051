// The panel: tabs beside the scene; in narrow windows a drawer, on a phone a sheet above the deck.

import type { FunctionComponent } from "preact";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { Health } from "../health/health";
import { Plots } from "../plots/plots";
import { useSession } from "../session";
import { type Tab, TABS } from "../store/layout";
import { Student } from "../student/student";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon, type IconName } from "../ui/icon";
import { DriveTab } from "./drive_tab";
import { ModulesTab } from "./modules_tab";
import { ViewTab } from "./view_tab";
import "./panel.css";

const CONTENTS: Record<Tab, FunctionComponent> = {
  drive: DriveTab,
  modules: ModulesTab,
  plots: Plots,
  health: Health,
  view: ViewTab,
  student: Student,
};

/** A phone has room for five; the Student tab needs a larger window. */
const PHONE_TABS: readonly (readonly [Tab, IconName])[] = [
  ["drive", "sliders"],
  ["modules", "wheel"],
  ["plots", "plot"],
  ["health", "heart"],
  ["view", "half"],
];

export function Panel() {
  const { layout, keyboard } = useSession();
  const { shell: words } = texts().panel;
  const isOpen = layout.panelOpen.value;
  const scrolls = useRef(new Map<Tab, number>());
  const moved = useRef(false); // Whether the button with the focus is about to disappear.
  const unfold = useRef<HTMLDivElement>(null);
  const panel = useRef<HTMLElement>(null);
  useEffect(
    () =>
      keyboard.bind("KeyP", () => {
        if (layout.panelOpen.peek()) layout.fold();
        else layout.open(layout.tab.peek());
      }),
    [keyboard],
  );
  // At once, so that it takes the focus from nothing that a later key opens.
  useLayoutEffect(() => {
    if (!moved.current) return;
    moved.current = false;
    const place = isOpen ? panel.current : unfold.current;
    place?.querySelector<HTMLElement>("[aria-selected=true], .btn")?.focus();
  }, [isOpen]);
  const fold = () => {
    moved.current = true;
    layout.fold();
  };
  const escape = (event: KeyboardEvent) => {
    if (event.code !== "Escape" || !(layout.narrow.peek() || layout.sideways.peek())) return;
    event.stopPropagation();
    fold();
  };
  return (
    <>
      {isOpen && (
        <aside ref={panel} class="panel" aria-label={words.label} onKeyDown={escape}>
          <Head onFold={fold} />
          <Body scrolls={scrolls.current} key={layout.tab.value} tab={layout.tab.value} />
        </aside>
      )}
      {!isOpen && !layout.phone.value && (
        <div class="unfold" ref={unfold}>
          <Button
            icon="fold"
            label={words.unfold}
            onPress={() => {
              moved.current = true;
              layout.open(layout.tab.peek());
            }}
          />
        </div>
      )}
      <PhoneTabs />
    </>
  );
}

function Head({ onFold }: { onFold: () => void }) {
  const { layout } = useSession();
  const { shell: words, tabs } = texts().panel;
  const isPhone = layout.phone.value;
  return (
    <div class="tabs">
      {isPhone ? <h2 class="t">{tabs[layout.tab.value]}</h2> : <Tabs />}
      <span class="spacer" />
      <Button icon={isPhone ? "close" : "fold"} label={words.fold} onPress={onFold} />
    </div>
  );
}

function Tabs() {
  const { layout } = useSession();
  const { shell: words, tabs } = texts().panel;
  const list = useRef<HTMLDivElement>(null);
  const move = (event: KeyboardEvent) => {
    const at = TABS.indexOf(layout.tab.peek());
    const to = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: -1 }[event.code];
    if (to === undefined) return;
    event.preventDefault();
    const tab = TABS.at(to % TABS.length)!;
    layout.tab.value = tab;
    list.current?.querySelector<HTMLElement>(`#tab-${tab}`)?.focus();
  };
  return (
    <div ref={list} class="list" role="tablist" aria-label={words.label} onKeyDown={move}>
      {TABS.map((tab) => (
        <button
          key={tab}
          id={`tab-${tab}`}
          type="button"
          role="tab"
          aria-selected={tab === layout.tab.value}
          aria-controls="tab-body"
          tabIndex={tab === layout.tab.value ? 0 : -1}
          onClick={() => (layout.tab.value = tab)}
        >
          {tabs[tab]}
        </button>
      ))}
    </div>
  );
}

/** Contents of a tab, scrolled as it was left. */
function Body({ tab, scrolls }: { tab: Tab; scrolls: Map<Tab, number> }) {
  const { layout } = useSession();
  const body = useRef<HTMLDivElement>(null);
  useLayoutEffect(() => {
    if (body.current) body.current.scrollTop = scrolls.get(tab) ?? 0;
  }, []);
  const Content = CONTENTS[tab];
  const named = layout.phone.value
    ? { role: "region" as const, "aria-label": texts().panel.tabs[tab] }
    : { role: "tabpanel" as const, "aria-labelledby": `tab-${tab}` };
  return (
    <div
      {...named}
      ref={body}
      id="tab-body"
      class="body"
      tabIndex={0}
      onScroll={({ currentTarget }) => scrolls.set(tab, currentTarget.scrollTop)}
    >
      <Content />
    </div>
  );
}

function PhoneTabs() {
  const { layout } = useSession();
  const { shell: words, tabs } = texts().panel;
  if (!layout.phone.value) return null;
  const isOpen = (tab: Tab) => layout.drawerOpen.value && layout.tab.value === tab;
  return (
    <nav class="phone-tabs" aria-label={words.label}>
      {PHONE_TABS.map(([tab, icon]) => (
        <button
          key={tab}
          type="button"
          class={isOpen(tab) ? "on" : undefined}
          aria-expanded={isOpen(tab)}
          onClick={() => (isOpen(tab) ? layout.fold() : layout.open(tab))}
        >
          <Icon name={icon} />
          {tabs[tab]}
        </button>
      ))}
    </nav>
  );
}
