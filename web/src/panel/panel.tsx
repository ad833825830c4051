// The panel: tabs next to the scene; in narrow windows a drawer, on a phone a sheet above the deck.

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

/** Contents of the tabs, and their icons on a phone, which has no room for the Student tab. */
const CONTENTS: Record<Tab, { Content: FunctionComponent; icon?: IconName }> = {
  drive: { Content: DriveTab, icon: "sliders" },
  modules: { Content: ModulesTab, icon: "wheel" },
  plots: { Content: Plots, icon: "plot" },
  health: { Content: Health, icon: "heart" },
  view: { Content: ViewTab, icon: "half" },
  student: { Content: Student },
};

export function Panel() {
  const { layout, keyboard } = useSession();
  const { shell: words, tabs } = texts().panel;
  const tab = layout.tab.value;
  const isOpen = layout.panelOpen.value;
  const isPhone = layout.phone.value;
  const { Content } = CONTENTS[tab];
  const body = useRef<HTMLDivElement>(null);
  const scrolls = useRef<Partial<Record<Tab, number>>>({});
  const moves = useRef(false); // Whether the button with the focus is about to disappear.
  const toggle = () => (layout.panelOpen.peek() ? layout.fold() : layout.open(layout.tab.peek()));
  useEffect(() => keyboard.bind({ KeyP: toggle }), [keyboard]);
  useLayoutEffect(() => {
    moves.current = false; // A phone has no button to open the panel.
    if (body.current) body.current.scrollTop = scrolls.current[tab] ?? 0;
  }, [tab, isOpen]);
  const press = () => {
    moves.current = true;
    toggle();
  };
  const escape = (event: KeyboardEvent) => {
    if (event.code !== "Escape" || !(layout.narrow.peek() || layout.sideways.peek())) return;
    event.stopPropagation();
    press();
  };
  /** At once, so that it takes the focus from nothing that a later key opens. */
  const takeFocus = (node: HTMLElement | null) => {
    if (node === null || !moves.current) return;
    moves.current = false;
    node.querySelector<HTMLElement>("[aria-selected=true], .btn")?.focus();
  };
  return (
    <>
      {isOpen && (
        <aside ref={takeFocus} class="panel" aria-label={words.label} onKeyDown={escape}>
          <div class="tabs">
            {isPhone ? (
              <h2 class="t" id={`tab-${tab}`}>
                {tabs[tab]}
              </h2>
            ) : (
              <Tabs />
            )}
            <span class="spacer" />
            <Button icon={isPhone ? "close" : "fold"} label={words.fold} onPress={press} />
          </div>
          <div
            key={tab}
            ref={body}
            id="tab-body"
            class="body"
            role={isPhone ? "region" : "tabpanel"}
            aria-labelledby={`tab-${tab}`}
            tabIndex={0}
            onScroll={({ currentTarget }) => (scrolls.current[tab] = currentTarget.scrollTop)}
          >
            <Content />
          </div>
        </aside>
      )}
      {!isOpen && !isPhone && (
        <div class="unfold" ref={takeFocus}>
          <Button icon="fold" label={words.unfold} onPress={press} />
        </div>
      )}
      {isPhone && <PhoneTabs />}
    </>
  );
}

function Tabs() {
  const { layout } = useSession();
  const { shell: words, tabs } = texts().panel;
  const move = (event: KeyboardEvent) => {
    const at = TABS.indexOf(layout.tab.peek());
    const to = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: -1 }[event.code];
    if (to === undefined) return;
    event.preventDefault();
    layout.tab.value = TABS.at(to % TABS.length)!;
    document.getElementById(`tab-${layout.tab.value}`)?.focus();
  };
  return (
    <div class="list" role="tablist" aria-label={words.label} onKeyDown={move}>
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

function PhoneTabs() {
  const { layout } = useSession();
  const { shell: words, tabs } = texts().panel;
  return (
    <nav class="phone-tabs" aria-label={words.label}>
      {TABS.map((tab) => {
        const { icon } = CONTENTS[tab];
        if (icon === undefined) return null;
        const isOpen = tab === layout.tab.value && layout.drawerOpen.value;
        return (
          <button
            key={tab}
            type="button"
            class={isOpen ? "on" : undefined}
            aria-expanded={isOpen}
            onClick={() => (isOpen ? layout.fold() : layout.open(tab))}
          >
            <Icon name={icon} />
            {tabs[tab]}
          </button>
        );
      })}
    </nav>
  );
}
