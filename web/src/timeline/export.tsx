// Export of a part of a recording. The dashboard makes it, which may take minutes.

import { duration } from "../text/numbers";
import { texts } from "../text/text";
import { parseTime } from "./clock";
import { answer } from "./library";
import { pathOf, type RowProps, save } from "./row";

const ENDINGS = { html: ".html", mcap: ".mcap", csv: ".zip" };
const KINDS = Object.keys(ENDINGS) as (keyof typeof ENDINGS)[];

/** Query of an export, or null if the times are invalid; without times, start and end. */
export function exportQuery(form: FormData): URLSearchParams | null {
  const query = new URLSearchParams();
  for (const [name, value] of form) {
    const text = String(value).trim();
    if (text === "") continue;
    const told = name === "as" ? text : parseTime(text);
    if (told === null) return null;
    query.set(name, String(told));
  }
  return Number(query.get("to") ?? Infinity) > Number(query.get("from")) ? query : null;
}

export function Export({ row, run }: RowProps) {
  const { timeline } = texts();
  const make = async (form: FormData) => {
    const query = exportQuery(form);
    if (query === null) throw new Error(timeline.notATime);
    const file = await answer("GET", `${pathOf(row)}/export?${query}`);
    const address = URL.createObjectURL(await file.blob());
    const name = row.title || row.name.replace(/\.mcap$/, "");
    save(address, name + ENDINGS[query.get("as") as keyof typeof ENDINGS]);
    setTimeout(() => URL.revokeObjectURL(address), 60_000);
  };
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const form = new FormData(event.currentTarget as HTMLFormElement, event.submitter);
    run(() => make(form), timeline.exporting);
  };
  return (
    <form class="export" onSubmit={submit}>
      {timeline.exportAs}
      {KINDS.map((kind) => (
        <button key={kind} class="btn edge" name="as" value={kind}>
          {timeline.exports[kind]}
        </button>
      ))}
      {(["from", "to"] as const).map((name) => (
        <label key={name}>
          {timeline[name]}
          <span class="field">
            <input
              name={name}
              inputMode="numeric"
              placeholder={name === "from" ? "0:00" : duration(row.duration_s)}
            />
          </span>
        </label>
      ))}
    </form>
  );
}
