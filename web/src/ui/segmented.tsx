// A few choices side by side, one of which holds: a radio group with arrow keys.

import type { ComponentChildren } from "preact";
import { Button } from "./button";

interface SegmentedProps<T extends string> {
  label: string;
  value: T;
  choices: readonly { value: T; text: ComponentChildren; refused?: string | null }[];
  onChoose: (value: T) => void;
}

export function Segmented<T extends string>(props: SegmentedProps<T>) {
  const { label, value, choices, onChoose } = props;
  const move = (event: KeyboardEvent) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.code];
    if (step === undefined) return;
    event.preventDefault();
    const free = choices.filter((choice) => choice.value === value || !choice.refused);
    const at = free.findIndex((choice) => choice.value === value);
    const next = free.at((at + step) % free.length)!;
    onChoose(next.value);
    const group = event.currentTarget as HTMLElement;
    (group.children[choices.indexOf(next)] as HTMLElement).focus();
  };
  return (
    <div class="seg" role="radiogroup" aria-label={label} onKeyDown={move}>
      {choices.map(({ value: each, text, refused }) => (
        <Button
          key={each}
          role="radio"
          class={each === value ? "on" : ""}
          aria-checked={each === value}
          refused={refused}
          tabIndex={each === value ? 0 : -1}
          onPress={() => onChoose(each)}
        >
          {text}
        </Button>
      ))}
    </div>
  );
}
