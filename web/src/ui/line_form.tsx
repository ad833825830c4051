// A form for one line of text.

import { texts } from "../text/text";
import { Button } from "./button";

interface LineFormProps {
  label: string;
  /** In place of a label above: the field and its buttons are one row. */
  hint?: string;
  /** Longest text in characters. */
  most: number;
  initial?: string;
  /** Text of the button, by default the label. */
  action?: string;
  onSend: (text: string) => void;
  onClose: () => void;
}

/** Focus a field at once: the next key must not be one of the page. */
export function focus(input: HTMLInputElement | null): void {
  input?.focus();
  input?.select();
}

/** One line of text with a button; in a row, Escape closes it, but not its surroundings. */
export function LineForm(props: LineFormProps) {
  const { label, hint, most, initial, action = label, onSend, onClose } = props;
  const isRow = hint !== undefined;
  const send = (event: SubmitEvent) => {
    event.preventDefault();
    const text = new FormData(event.currentTarget as HTMLFormElement).get("text");
    onSend(String(text).trim());
    onClose();
  };
  const key = (event: KeyboardEvent) => {
    if (event.code !== "Escape" || !isRow) return;
    event.stopPropagation();
    onClose();
  };
  const more = { maxLength: most, defaultValue: initial, placeholder: hint, "aria-label": label };
  const field = (
    <span class="field">
      <input ref={isRow ? focus : undefined} name="text" dir="auto" {...more} />
    </span>
  );
  return (
    <form class={isRow ? "line-form" : undefined} onSubmit={send} onKeyDown={key}>
      {isRow ? field : <label>{[label, field]}</label>}
      {!isRow && <p class="note">{texts().bar.spaceTypes}</p>}
      <Button edge submit children={action} />
      {isRow && <Button icon="close" label={texts().common.cancel} onPress={onClose} />}
    </form>
  );
}
