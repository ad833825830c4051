// A section that folds; its head shows a summary while it is closed.

import type { ComponentChildren } from "preact";
import { Icon } from "./icon";

interface FoldProps {
  title: string;
  summary?: ComponentChildren;
  children: ComponentChildren;
}

export function Fold({ title, summary, children }: FoldProps) {
  return (
    <details class="foldable">
      <summary class="fold">
        <Icon name="right" />
        {title}
        {summary !== undefined && <span class="v">{summary}</span>}
      </summary>
      <div class="inside">{children}</div>
    </details>
  );
}
