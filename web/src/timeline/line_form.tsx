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

/** Focus a field at once: the next key must not be one of the page. */
function focus(input: HTMLInputElement | null): void {
  input?.focus();
  input?.select();
}

/** One line of text with a button; Escape closes it, but not its surroundings. */
export function LineForm({ label, hint, most, initial, onSend, onClose }: LineFormProps) {
  const send = (event: SubmitEvent) => {
    event.preventDefault();
    const text = new FormData(event.currentTarget as HTMLFormElement).get("text");
    onSend(String(text).trim());
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
          ref={focus}
          name="text"
          maxLength={most}
          defaultValue={initial}
          placeholder={hint}
          aria-label={label}
        />
      </span>
      <Button edge submit children={label} />
      <Button icon="close" label={texts().common.cancel} onPress={onClose} />
    </form>
  );
}
