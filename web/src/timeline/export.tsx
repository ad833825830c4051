// Export of a part of a recording. The dashboard makes it, which may take minutes.

import { useState } from "preact/hooks";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Segmented } from "../ui/segmented";
import { duration } from "../text/numbers";
import { parseTime } from "./clock";
import { answer, Refused } from "./request";
import { type RowProps, save } from "./row";

const ENDINGS = { html: ".html", mcap: ".mcap", csv: ".zip" };
type Kind = keyof typeof ENDINGS;

/** Query of an export, or null if the times are none; empty times are start and end. */
export function exportQuery(kind: Kind, from: string, to: string, robot: string): string | null {
  const query = new URLSearchParams({ as: kind });
  const [fromS, toS] = [from, to].map((text) => (text.trim() === "" ? undefined : parseTime(text)));
  if (fromS === null || toS === null || (toS ?? Infinity) <= (fromS ?? 0)) return null;
  if (fromS !== undefined) query.set("from", String(fromS));
  if (toS !== undefined) query.set("to", String(toS));
  if (robot !== "") query.set("robot", robot);
  return query.toString();
}

export function Export({ row, run }: RowProps) {
  const { timeline } = texts();
  const [kind, setKind] = useState<Kind>("html");
  const [robot, setRobot] = useState("");
  const [from, setFrom] = useState("");
  const [to, setTo] = useState("");
  const [busy, setBusy] = useState(false);
  const make = async () => {
    const query = exportQuery(kind, from, to, robot);
    if (query === null) throw new Refused("", timeline.notATime);
    setBusy(true);
    try {
      const file = await answer("GET", `${encodeURIComponent(row.name)}/export?${query}`);
      const address = URL.createObjectURL(await file.blob());
      save(address, (row.title || row.name.replace(/\.mcap$/, "")) + ENDINGS[kind]);
      setTimeout(() => URL.revokeObjectURL(address), 60_000);
    } finally {
      setBusy(false);
    }
    return null;
  };
  const time = (label: string, value: string, set: (text: string) => void, hint: string) => (
    <label>
      {label}
      <span class="field">
        <input
          inputMode="numeric"
          value={value}
          placeholder={hint}
          onInput={(event) => set(event.currentTarget.value)}
        />
      </span>
    </label>
  );
  return (
    <div class="export">
      <Segmented
        label={timeline.exportAs}
        value={kind}
        choices={(Object.keys(ENDINGS) as Kind[]).map((each) => ({
          value: each,
          text: timeline.exports[each],
        }))}
        onChoose={setKind}
      />
      {time(timeline.from, from, setFrom, "0:00")}
      {time(timeline.to, to, setTo, duration(row.duration_s))}
      {row.robots.length > 1 && (
        <select
          aria-label={timeline.robot}
          value={robot}
          onChange={(event) => setRobot(event.currentTarget.value)}
        >
          <option value="">{timeline.allRobots}</option>
          {row.robots.map((each) => (
            <option key={each}>{each}</option>
          ))}
        </select>
      )}
      <Button edge refused={busy ? timeline.exporting : null} onPress={() => void run(make)}>
        {timeline.export}
      </Button>
      {busy && <span class="note">{timeline.exporting}</span>}
    </div>
  );
}
