// Form for a goal in numbers. It plans; the path is then followed by holding G or the deck's button.

import { useRef } from "preact/hooks";
import { isOnFloor } from "../drive/axes";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { whyNotPlan } from "../store/permission";
import { degrees, figure } from "../text/numbers";
import { refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";

const FIELDS = ["x", "y", "heading"] as const;
const MOST = 10_000; // Limit of a message.

export function GoToForm() {
  const { link, path } = useSession();
  const form = useRef<HTMLFormElement>(null);
  const { form: words } = texts().scene;
  if (!isOnFloor(link.robot.value)) return null;
  const pose = isCurrent(freshness(link)) ? link.state.value?.pose : null;
  const [x = 0, y = 0, heading] = pose ?? [];
  const shown = {
    x: figure(pose?.[0], 2),
    y: figure(pose?.[1], 2),
    heading: figure(degrees(heading)),
  };
  const refusal = whyNotPlan(link);
  const plan = () => {
    if (!pose || !form.current?.reportValidity()) return; // The browser reports invalid numbers.
    const typed = (name: (typeof FIELDS)[number]) => {
      const { value } = form.current!.elements.namedItem(name) as HTMLInputElement;
      return value === "" ? null : Number(value);
    };
    const headingDeg = typed("heading");
    path.plan({
      kind: "to",
      on: "floor",
      points: [[typed("x") ?? x, typed("y") ?? y]],
      heading: headingDeg === null ? null : (headingDeg * Math.PI) / 180,
    });
  };
  const submit = (event: Event) => {
    event.preventDefault();
    if (refusal === null) plan();
  };
  const route = path.route.value;
  const next = route?.phase === "planned" ? words.planned(figure(route.length_m, 2)) : words.hint;
  return (
    <form ref={form} class="goto" aria-label={words.label} noValidate onSubmit={submit}>
      {FIELDS.map((name) => (
        <label key={name}>
          {words[name]}
          <span class="field">
            <input
              type="number"
              name={name}
              step="any"
              min={-MOST}
              max={MOST}
              inputMode="decimal"
              placeholder={shown[name]}
            />
          </span>
        </label>
      ))}
      <Button edge submit refused={refusal && refusalText(refusal)}>
        {words.plan}
      </Button>
      <p class="note" role="status">
        {refusal ? refusalText(refusal) : next}
      </p>
    </form>
  );
}
