import { useLayoutEffect, useRef } from "preact/hooks";
import { texts } from "../text/text";
import { Button } from "../ui/button";

interface LineFormProps {
  label: string;
  hint: string;
  /** Longest text in characters. */
  most: number;
  initial?: string;
  onSend: (text: string) => void;
  onClose: () => void;
}

/** One line of text with a button; Escape leaves it, and not what is around it. */
export function LineForm({ label, hint, most, initial, onSend, onClose }: LineFormProps) {
  const input = useRef<HTMLInputElement>(null);
  // At once: the next key must not be one of the page.
  useLayoutEffect(() => {
    input.current?.focus();
    input.current?.select();
  }, []);
  const send = (event: Event) => {
    event.preventDefault();
    onSend(input.current?.value.trim() ?? "");
    onClose();
  };
  const key = (event: KeyboardEvent) => {
    if (event.code !== "Escape") return;
    event.stopPropagation();
    onClose();
  };
  return (
    <form class="line-form" onSubmit={send} onKeyDown={key}>
      <span class="field">
        <input
          ref={input}
          maxLength={most}
          defaultValue={initial}
          placeholder={hint}
          aria-label={label}
        />
      </span>
      <button type="submit" class="btn edge">
        {label}
      </button>
      <Button icon="close" label={texts().common.cancel} onPress={onClose} />
    </form>
  );
}
