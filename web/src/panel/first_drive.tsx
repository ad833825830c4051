// The four steps of a first drive, at the top of the Drive tab until all are done or skipped.

import { useEffect, useState } from "preact/hooks";
import type { RobotState } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { isFlag, remembered } from "../store/memory";
import { texts } from "../text/text";
import { Button } from "../ui/button";

/** Whether the operator has done or skipped the steps. */
export const wasDriven = remembered("tsd-was-driven", false, isFlag);

export function FirstDrive() {
  const { link } = useSession();
  const { first } = texts().panel;
  const [open, setOpen] = useState(!wasDriven.peek()); // It goes neither while one drives nor stops.
  const [done, setDone] = useState(0);
  const state = link.state.value;
  useEffect(() => {
    if (!open || state === null || !isCurrent(freshness(link))) return;
    const now = stepsDone(state, done);
    setDone(now);
    if (now === first.steps.length) wasDriven.value = true;
  }, [state]);
  if (!open) return null;
  const close = () => {
    wasDriven.value = true;
    setOpen(false);
  };
  const isDone = done === first.steps.length;
  return (
    <section class="sec first">
      <h2>
        {first.title} <small>{isDone ? first.done : first.duration}</small>
      </h2>
      <ol>
        {first.steps.map(({ title, text }, i) => (
          <li key={title} aria-current={i === done ? "step" : undefined}>
            <span class="n" aria-hidden="true">
              {i < done ? "✓" : i + 1}
            </span>
            <b>
              {title}
              {i < done && <span class="sr"> {first.done}</span>}
            </b>
            <p>{text}</p>
          </li>
        ))}
      </ol>
      <Button edge onPress={close} children={isDone ? texts().common.close : first.skip} />
    </section>
  );
}

/** Return how many steps a state shows to be done, after `before` of them. */
export function stepsDone({ status, has_control }: RobotState, before: number): number {
  if (before >= 3) return status.mode === "stopped" ? 4 : before;
  if (!has_control) return 0;
  return { driving: 3, ready: 2 }[status.mode as string] ?? 1;
}
