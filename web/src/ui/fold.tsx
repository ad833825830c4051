// A section that folds; its head shows a summary while it is closed.

import type { ComponentChildren } from "preact";
import { Icon } from "./icon";

interface FoldProps {
  title: string;
  summary?: ComponentChildren;
  open?: boolean;
  children: ComponentChildren;
}

export function Fold({ title, summary, open, children }: FoldProps) {
  return (
    <details class="foldable" open={open}>
      <summary class="fold">
        <Icon name="right" />
        {title}
        {summary !== undefined && <span class="v">{summary}</span>}
      </summary>
      <div class="inside">{children}</div>
    </details>
  );
}
