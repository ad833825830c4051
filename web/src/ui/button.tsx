// Buttons. A disabled one stays focusable and says why.

import type { ComponentChildren } from "preact";
import { useEffect, useId, useRef, useState } from "preact/hooks";
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
  /** Whether it submits its form, as Enter in a field then does. */
  submit?: boolean;
  onPress?: () => void;
}

export function Button(props: ButtonProps) {
  const { children, icon, label, refused = null, edge, pressed, expanded, submit } = props;
  const why = useId();
  const classes = ["btn", edge && "edge", children === undefined && "icon", props.class];
  return (
    <button
      type={submit ? "submit" : "button"}
      class={classes.filter(Boolean).join(" ")}
      aria-label={label}
      title={refused ?? (children === undefined ? label : undefined)}
      aria-disabled={refused !== null || undefined}
      aria-describedby={refused === null ? undefined : why}
      aria-pressed={pressed}
      aria-expanded={expanded}
      onClick={() => refused === null && props.onPress?.()}
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

/**
 * The one filled button of a page: the next step. Give each step its own `key`: a press that begins
 * on one step must not end on the next.
 */
export function NextStep(props: NextStepProps) {
  const { children, refused = null, hold = false, busy = false } = props;
  const latest = useRef(props); // What is allowed may change during a hold.
  latest.current = props;
  const [holding, setHolding] = useState(false);
  const timer = useRef(0);
  const why = useId();
  const act = () => {
    const { refused: refusal = null, busy: pending, onPress } = latest.current;
    if (refusal === null && !pending) onPress();
  };
  const end = () => {
    clearTimeout(timer.current);
    setHolding(false);
  };
  const begin = () => {
    if (!hold) return;
    clearTimeout(timer.current);
    setHolding(true);
    timer.current = window.setTimeout(() => {
      setHolding(false);
      act();
    }, HOLD_MS);
  };
  const key = (event: KeyboardEvent) => {
    if (event.key !== "Enter" || !hold) return;
    event.preventDefault();
    if (event.type === "keyup") end();
    else if (!event.repeat) begin();
  };
  // Assistive technology cannot hold: its click counts, with neither key nor pointer before it.
  const click = (event: MouseEvent) => (!hold || event.detail === 0) && act();
  useEffect(() => () => clearTimeout(timer.current), []);
  return (
    <button
      type="button"
      class={holding ? "next holding" : "next"}
      aria-disabled={refused !== null || undefined}
      aria-busy={busy || undefined}
      aria-describedby={refused === null ? undefined : why}
      title={refused ?? undefined}
      onClick={click}
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
