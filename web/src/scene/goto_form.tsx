// Form for a goal in numbers. It plans; the path is then followed by holding G or the deck's button.

import { useSession } from "../session";
import { currentState } from "../store/freshness";
import { whyNotPlan } from "../store/permission";
import { refusalText } from "../text/reasons";
import { degrees, figure, texts } from "../text/text";
import { Button } from "../ui/button";

const MOST = 10_000; // Limit of a message.

export function GoToForm() {
  const { link, path } = useSession();
  const { form: words } = texts().scene;
  const pose = currentState(link)?.pose;
  const refusal = whyNotPlan(link);
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (refusal !== null || !pose) return;
    const typed = new FormData(event.currentTarget as HTMLFormElement);
    const numberOf = (name: string) => (typed.get(name) === "" ? null : Number(typed.get(name)));
    const heading = numberOf("heading");
    path.plan({
      kind: "to",
      on: "floor",
      points: [[numberOf("x") ?? pose[0], numberOf("y") ?? pose[1]]],
      heading: heading === null ? null : (heading * Math.PI) / 180,
    });
  };
  const route = path.route.value;
  const next = route?.phase === "planned" ? words.planned(figure(route.length_m, 2)) : words.hint;
  const fields = {
    x: figure(pose?.[0], 2),
    y: figure(pose?.[1], 2),
    heading: figure(degrees(pose?.[2])),
  };
  return (
    <form class="goto" aria-label={words.label} onSubmit={submit}>
      {(["x", "y", "heading"] as const).map((name) => (
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
              placeholder={fields[name]}
            />
          </span>
        </label>
      ))}
      <Button edge submit refused={refusal && refusalText(refusal)} children={words.plan} />
      <p class="note" role="status">
        {refusal ? refusalText(refusal) : next}
      </p>
    </form>
  );
}
