// Buttons. A disabled one stays focusable and says why.

import type { ComponentChildren } from "preact";
import { useId, useRef, useState } from "preact/hooks";
import { Icon, type IconName } from "./icon";

export interface ButtonProps {
  children?: ComponentChildren;
  icon?: IconName;
  /** Accessible name, if it has no text or needs more. */
  label?: string;
  /** Why it cannot be pressed now, or null. */
  refused?: string | null;
  edge?: boolean;
  class?: string;
  pressed?: boolean;
  expanded?: boolean;
  onPress: () => void;
}

export function Button(props: ButtonProps) {
  const { children, icon, label, refused = null, edge, pressed, expanded, onPress } = props;
  const why = useId();
  const classes = ["btn", edge && "edge", children === undefined && "icon", props.class];
  return (
    <button
      type="button"
      class={classes.filter(Boolean).join(" ")}
      aria-label={label}
      title={refused ?? (children === undefined ? label : undefined)}
      aria-disabled={refused !== null || undefined}
      aria-describedby={refused === null ? undefined : why}
      aria-pressed={pressed}
      aria-expanded={expanded}
      onClick={() => refused === null && onPress()}
    >
      {icon && <Icon name={icon} />}
      {children}
      {refused !== null && (
        <span class="sr" id={why}>
          {refused}
        </span>
      )}
    </button>
  );
}

const HOLD_MS = 1000;

export interface NextStepProps {
  children: ComponentChildren;
  refused?: string | null;
  /** Whether it acts only after it was held for a second. */
  hold?: boolean;
  /** Whether its request is under way. */
  busy?: boolean;
  onPress: () => void;
}

/** The one filled button of a page: the next step. */
export function NextStep({ children, refused = null, hold, busy, onPress }: NextStepProps) {
  const [holding, setHolding] = useState(false);
  const timer = useRef(0);
  const why = useId();
  const end = () => {
    clearTimeout(timer.current);
    setHolding(false);
  };
  const begin = () => {
    if (!hold || refused !== null || holding) return;
    setHolding(true);
    timer.current = window.setTimeout(() => {
      setHolding(false);
      onPress();
    }, HOLD_MS);
  };
  const key = (event: KeyboardEvent) => {
    if (event.code !== "Enter" || !hold) return;
    event.preventDefault();
    if (event.type === "keyup") end();
    else if (!event.repeat) begin();
  };
  return (
    <button
      type="button"
      class={holding ? "next holding" : "next"}
      aria-disabled={refused !== null || undefined}
      aria-busy={busy || undefined}
      aria-describedby={refused === null ? undefined : why}
      title={refused ?? undefined}
      onClick={() => !hold && refused === null && onPress()}
      onPointerDown={(event) => event.button === 0 && begin()}
      onPointerUp={end}
      onPointerLeave={end}
      onPointerCancel={end}
      onBlur={end}
      onKeyDown={key}
      onKeyUp={key}
      onContextMenu={(event) => event.preventDefault()}
    >
      <i class="fill" aria-hidden="true" />
      <span>{children}</span>
      {refused !== null && (
        <span class="sr" id={why}>
          {refused}
        </span>
      )}
    </button>
  );
}
