// Export of a part of a recording. The dashboard makes it, which may take minutes.

import { useRef, useState } from "preact/hooks";
import { duration } from "../text/numbers";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { parseTime } from "./clock";
import { answer } from "./library";
import { pathOf, type RowProps, save } from "./row";

const ENDINGS = { html: ".html", mcap: ".mcap", csv: ".zip" };
type Kind = keyof typeof ENDINGS;

/** Query of an export, or null if the times are invalid; what is left empty is not limited. */
export function exportQuery(form: FormData): URLSearchParams | null {
  const query = new URLSearchParams();
  for (const [name, value] of form) {
    const text = String(value).trim();
    const told = name === "from" || name === "to" ? parseTime(text) : text;
    if (told === null && text !== "") return null;
    if (text !== "") query.set(name, String(told));
  }
  return Number(query.get("to") ?? Infinity) > Number(query.get("from")) ? query : null;
}

export function Export({ row, run }: RowProps) {
  const { timeline } = texts();
  const form = useRef<HTMLFormElement>(null);
  const [busy, setBusy] = useState(false);
  const make = async () => {
    const query = exportQuery(new FormData(form.current!));
    if (query === null) throw new Error(timeline.notATime);
    setBusy(true);
    try {
      const file = await answer("GET", `${pathOf(row)}/export?${query}`);
      const address = URL.createObjectURL(await file.blob());
      const ending = ENDINGS[query.get("as") as Kind];
      save(address, (row.title || row.name.replace(/\.mcap$/, "")) + ending);
      setTimeout(() => URL.revokeObjectURL(address), 60_000);
    } finally {
      setBusy(false);
    }
  };
  const time = (name: "from" | "to", hint: string) => (
    <label>
      {timeline[name]}
      <span class="field">
        <input name={name} inputMode="numeric" placeholder={hint} />
      </span>
    </label>
  );
  return (
    <form class="export" ref={form} onSubmit={(event) => event.preventDefault()}>
      <span role="radiogroup" aria-label={timeline.exportAs}>
        {(Object.keys(ENDINGS) as Kind[]).map((kind) => (
          <label key={kind}>
            <input type="radio" name="as" value={kind} defaultChecked={kind === "html"} />
            {timeline.exports[kind]}
          </label>
        ))}
      </span>
      {time("from", "0:00")}
      {time("to", duration(row.duration_s))}
      {row.robots.length > 1 && (
        <select name="robot" aria-label={timeline.robot}>
          <option value="">{timeline.allRobots}</option>
          {row.robots.map((robot) => (
            <option key={robot}>{robot}</option>
          ))}
        </select>
      )}
      <Button edge refused={busy ? timeline.exporting : null} onPress={() => run(make)}>
        {timeline.export}
      </Button>
      {busy && <span class="note">{timeline.exporting}</span>}
    </form>
  );
}
