// Buttons. A disabled one stays focusable and says why, as its description.

import type { AriaAttributes, ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { Icon, type IconName } from "./icon";

export interface ButtonProps extends AriaAttributes {
  children?: ComponentChildren;
  icon?: IconName;
  /** Accessible name, if it has no text or needs more. */
  label?: string;
  /** Why it cannot be pressed now, or null. */
  refused?: string | null;
  edge?: boolean;
  class?: string;
  expanded?: boolean;
  /** Whether it submits its form, as Enter in a field then does. */
  submit?: boolean;
  role?: "radio" | "menuitem" | "menuitemradio";
  tabIndex?: number;
  onPress?: () => void;
}

export function Button(props: ButtonProps) {
  const { children, icon, label, refused, edge, expanded, submit, onPress, ...others } = props;
  const classes = ["btn", edge && "edge", children === undefined && "icon", props.class];
  return (
    <button
      {...others}
      type={submit ? "submit" : "button"}
      class={classes.filter(Boolean).join(" ")}
      aria-label={label}
      title={refused ?? (children === undefined ? label : undefined)}
      aria-disabled={refused ? true : undefined}
      aria-expanded={expanded}
      onClick={() => !refused && onPress?.()}
    >
      {icon && <Icon name={icon} />}
      {children}
    </button>
  );
}

const HOLD_MS = 1000;

export interface NextStepProps {
  children: ComponentChildren;
  refused?: string | null;
  /** Whether it acts only after it was held for a second. */
  hold?: boolean;
  busy?: boolean;
  onPress: () => void;
}

/**
 * The one filled button of a page: the next step. Give each step its own `key`: a press that begins
 * on one step must not end on the next.
 */
export function NextStep(props: NextStepProps) {
  const { children, refused = null, hold = false, busy = false, onPress } = props;
  const [holding, setHolding] = useState(false);
  const act = useRef(() => {}); // Permission may change during a hold.
  act.current = () => {
    if (refused === null && !busy) onPress();
  };
  const begin = () => setHolding(hold);
  const end = () => setHolding(false);
  useEffect(() => {
    if (!holding) return undefined;
    const timer = setTimeout(() => {
      end();
      act.current();
    }, HOLD_MS);
    return () => clearTimeout(timer);
  }, [holding]);
  const key = (event: KeyboardEvent) => {
    if (event.key !== "Enter" || !hold) return;
    event.preventDefault();
    if (event.type === "keyup") end();
    else if (!event.repeat) begin();
  };
  // Assistive technology cannot hold: its click counts, with neither key nor pointer before it.
  const click = (event: MouseEvent) => (!hold || event.detail === 0) && act.current();
  return (
    <button
      type="button"
      class={holding ? "next holding" : "next"}
      aria-disabled={refused !== null || undefined}
      aria-busy={busy || undefined}
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
    </button>
  );
}
