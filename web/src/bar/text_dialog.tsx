// A dialog that asks for one line of text.

import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";

interface TextDialogProps {
  title: string;
  /** What the text is for. */
  children: ComponentChildren;
  label: string;
  initial?: string;
  /** Most characters of the text. */
  most: number;
  action: string;
  onSubmit: (text: string) => void;
  onClose: () => void;
}

export function TextDialog(props: TextDialogProps) {
  const { title, children, label, initial = "", most, action, onSubmit, onClose } = props;
  const { bar, common } = texts();
  const input = useRef<HTMLInputElement>(null);
  const submit = (event: Event) => {
    event.preventDefault();
    onSubmit(input.current?.value.trim() ?? "");
    onClose();
  };
  return (
    <Dialog title={title} onClose={onClose}>
      <form onSubmit={submit}>
        <p>{children}</p>
        <label>
          {label}
          <span class="field">
            <input ref={input} dir="auto" maxLength={most} defaultValue={initial} />
          </span>
        </label>
        <p class="note">{bar.spaceTypes}</p>
        <div class="row">
          <Button onPress={onClose}>{common.cancel}</Button>
          <button type="submit" class="btn edge">
            {action}
          </button>
        </div>
      </form>
    </Dialog>
  );
}
