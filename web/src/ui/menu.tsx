// A button that opens a list of actions or choices.

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { Button } from "./button";

export interface MenuItem {
  text: ComponentChildren;
  /** Whether it is the one that holds, for choices; undefined for actions. */
  checked?: boolean;
  refused?: string | null;
  onChoose: () => void;
}

interface MenuProps {
  /** Accessible name of the button, or its description if its text is the name. */
  label: string;
  named?: boolean;
  button: ComponentChildren;
  items: readonly MenuItem[];
  class?: string;
}

export function Menu({ label, named = false, button, items, class: classes = "" }: MenuProps) {
  const [open, setOpen] = useState(false);
  const box = useRef<HTMLSpanElement>(null);
  const nodes = () => [...(box.current?.querySelectorAll<HTMLElement>("[role^=menuitem]") ?? [])];
  const close = () => {
    setOpen(false);
    box.current?.querySelector("button")?.focus();
  };
  useEffect(() => {
    if (!open) return undefined;
    nodes()[0]?.focus();
    const outside = (event: Event) => box.current?.contains(event.target as Node) || setOpen(false);
    addEventListener("pointerdown", outside);
    return () => removeEventListener("pointerdown", outside);
  }, [open]);
  const move = (event: KeyboardEvent) => {
    if (!open) return;
    const list = nodes();
    const at = list.indexOf(document.activeElement as HTMLElement);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: -1 }[event.code];
    if (event.code === "Escape") close();
    else if (to === undefined) return;
    else list.at(to % list.length)?.focus();
    event.preventDefault();
    event.stopPropagation();
  };
  return (
    <span class={`menu ${classes}`} ref={box} onKeyDown={move}>
      <Button
        label={named ? undefined : label}
        aria-description={named ? label : undefined}
        aria-haspopup="menu"
        expanded={open}
        onPress={() => setOpen(!open)}
      >
        {button}
      </Button>
      {open && (
        <div class="items" role="menu" aria-label={label}>
          {items.map(({ text, checked, refused, onChoose }, i) => (
            <Button
              key={i}
              role={checked === undefined ? "menuitem" : "menuitemradio"}
              aria-checked={checked}
              refused={refused}
              tabIndex={-1}
              onPress={() => {
                close();
                onChoose();
              }}
            >
              {text}
            </Button>
          ))}
        </div>
      )}
    </span>
  );
}
