// A few choices side by side, one of which holds: a radio group with arrow keys.

import type { ComponentChildren } from "preact";

export interface SegmentedProps<T extends string> {
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
    const group = event.currentTarget as HTMLElement;
    const at = choices.findIndex((choice) => choice.value === value);
    for (let i = 1; i <= choices.length; i++) {
      const next = (at + i * step + i * choices.length) % choices.length;
      if (choices[next]?.refused) continue;
      onChoose(choices[next]!.value);
      (group.children[next] as HTMLElement).focus();
      return;
    }
  };
  return (
    <div class="seg" role="radiogroup" aria-label={label} onKeyDown={move}>
      {choices.map((choice) => (
        <button
          key={choice.value}
          type="button"
          role="radio"
          class={choice.value === value ? "btn on" : "btn"}
          aria-checked={choice.value === value}
          aria-disabled={choice.refused ? true : undefined}
          title={choice.refused ?? undefined}
          tabIndex={choice.value === value ? 0 : -1}
          onClick={() => !choice.refused && onChoose(choice.value)}
        >
          {choice.text}
        </button>
      ))}
    </div>
  );
}
