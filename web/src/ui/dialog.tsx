// A dialog above the scene that leaves the deck, and so STOP, free. Not modal for that reason: keys
// and pointers still reach STOP.

import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { texts } from "../text/text";
import { Button } from "./button";

interface DialogProps {
  title: string;
  children: ComponentChildren;
  onClose: () => void;
}

export function Dialog({ title, children, onClose }: DialogProps) {
  const box = useRef<HTMLDivElement>(null);
  // At once: the next key must not be one of the page.
  useLayoutEffect(() => {
    const before = document.activeElement as HTMLElement | null;
    const first = box.current?.querySelector<HTMLElement>("input, textarea, select");
    (first ?? box.current)?.focus();
    return () => before?.focus();
  }, []);
  const key = (event: KeyboardEvent) => {
    if (event.code !== "Escape") return;
    event.stopPropagation();
    onClose();
  };
  return (
    <div class="shade" onPointerDown={(event) => event.target === event.currentTarget && onClose()}>
      <div ref={box} class="dialog" role="dialog" aria-label={title} tabIndex={-1} onKeyDown={key}>
        <header role="presentation">
          <h2 class="t">{title}</h2>
          <Button icon="close" label={texts().common.close} onPress={onClose} />
        </header>
        <div class="inside">{children}</div>
      </div>
    </div>
  );
}
