// A few choices side by side, one of which holds: a radio group with arrow keys.

import { Button } from "./button";

interface SegmentedProps<T extends string> {
  label: string;
  value: T;
  /** Texts of the choices, in order. */
  choices: Partial<Record<T, string>>;
  /** Why a choice cannot be made now. */
  refused?: Partial<Record<T, string | null>>;
  onChoose: (value: T) => void;
}

export function Segmented<T extends string>(props: SegmentedProps<T>) {
  const { label, value, choices, refused, onChoose } = props;
  const all = Object.keys(choices) as T[];
  const move = (event: KeyboardEvent) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.code];
    if (step === undefined) return;
    event.preventDefault();
    const free = all.filter((each) => each === value || !refused?.[each]);
    const next = free.at((free.indexOf(value) + step) % free.length)!;
    onChoose(next);
    const group = event.currentTarget as HTMLElement;
    (group.children[all.indexOf(next)] as HTMLElement).focus();
  };
  return (
    <div class="seg" role="radiogroup" aria-label={label} onKeyDown={move}>
      {all.map((each) => (
        <Button
          key={each}
          role="radio"
          class={each === value ? "on" : ""}
          aria-checked={each === value}
          refused={refused?.[each]}
          tabIndex={each === value ? 0 : -1}
          onPress={() => onChoose(each)}
        >
          {choices[each]}
        </Button>
      ))}
    </div>
  );
}
