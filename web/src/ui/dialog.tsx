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
  const key = useRef((_: KeyboardEvent) => {});
  key.current = (event) => {
    if (event.code !== "Escape") return;
    event.stopPropagation();
    onClose();
  };
  // At once: the next key must not be one of the page.
  useLayoutEffect(() => {
    const node = box.current!;
    const before = document.activeElement as HTMLElement | null;
    (node.querySelector<HTMLElement>("input, textarea, select") ?? node).focus();
    // Escape closes it wherever the focus is; its content handles the key first.
    const outside = (event: KeyboardEvent) =>
      node.contains(event.target as Node) || key.current(event);
    document.addEventListener("keydown", outside, true);
    return () => {
      document.removeEventListener("keydown", outside, true);
      before?.focus();
    };
  }, []);
  return (
    <div class="shade" onPointerDown={(event) => event.target === event.currentTarget && onClose()}>
      <div
        ref={box}
        class="dialog"
        role="dialog"
        aria-label={title}
        tabIndex={-1}
        onKeyDown={(event) => key.current(event)}
      >
        <header role="presentation">
          <h2 class="t">{title}</h2>
          <Button icon="close" label={texts().common.close} onPress={onClose} />
        </header>
        <div class="inside">{children}</div>
      </div>
    </div>
  );
}
