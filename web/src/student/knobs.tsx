// Numbers of the description that can be turned, and what to do with the result.

import { useSignal } from "@preact/signals";
import type { StudentKnob } from "../generated/wire";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Fold } from "../ui/fold";
import type { StudentModel } from "./model";

const URL_KEPT_MS = 10_000; // The browser may read the file some time after the click.

/** Number of the wheel that a key is about, or undefined. */
function wheelOf(key: string): string | undefined {
  return /\.(\d+)(\.\w+)?$/.exec(key)?.[1];
}

export function Knobs({ model }: { model: StudentModel }) {
  const { student } = texts();
  const reply = model.reply.value;
  if (reply === null) return null;
  const { knobs, base } = model.setting.value;
  const wheels = [...new Set(reply.knobs.map(({ key }) => wheelOf(key)))].filter(
    (wheel) => wheel !== undefined,
  );
  const rows = (wheel: string | undefined) =>
    reply.knobs
      .filter(({ key }) => wheelOf(key) === wheel)
      .map((knob) => (
        <Knob key={knob.key} knob={knob} value={knobs[knob.key] ?? knob.value} model={model} />
      ));
  return (
    <section class="sec" aria-label={student.knobs}>
      <label class="field base">
        {student.base}
        <select value={base} onChange={(event) => model.choose(event.currentTarget.value)}>
          {reply.bases.map(({ id, title }) => (
            <option key={id} value={id}>
              {title}
            </option>
          ))}
        </select>
      </label>
      <div class="knobs">{rows(undefined)}</div>
      {wheels.map((wheel) => (
        <Fold key={wheel} title={student.wheel(Number(wheel) + 1)}>
          <div class="knobs">{rows(wheel)}</div>
        </Fold>
      ))}
    </section>
  );
}

interface KnobProps {
  knob: StudentKnob;
  value: number;
  model: StudentModel;
}

function Knob({ knob, value, model }: KnobProps) {
  const { student } = texts();
  const { key, label, unit, least, most, step } = knob;
  const name = student.labels[label] ?? label;
  const limits = { min: least, max: most, step, value: Number(value.toPrecision(6)) };
  const take = (event: { currentTarget: HTMLInputElement }) => {
    const entered = event.currentTarget.valueAsNumber;
    if (Number.isFinite(entered)) model.turn(key, entered);
  };
  return (
    <div class="knob">
      <span aria-hidden="true">{name}</span>
      <input type="range" aria-label={name} {...limits} onInput={take} />
      <span class="v">
        <input type="number" aria-label={`${name}, ${unit}`} {...limits} onInput={take} />
        <span class="u">{unit}</span>
      </span>
    </div>
  );
}

export function Actions({ model }: { model: StudentModel }) {
  const { student } = texts();
  const said = useSignal("");
  model.onToml = (base, toml) => {
    const url = URL.createObjectURL(new Blob([toml], { type: "application/toml" }));
    const link = document.createElement("a");
    link.href = url;
    link.download = `my-${base}.toml`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), URL_KEPT_MS);
    said.value = student.saved(link.download);
  };
  const copy = async () => {
    const address = model.link();
    try {
      await navigator.clipboard.writeText(address);
      said.value = student.copied;
    } catch {
      said.value = address; // Without permission, or over plain HTTP.
    }
  };
  return (
    <div class="actions">
      <span class="said" role="status">
        {said.value}
      </span>
      <Button onPress={() => model.reset()}>{student.reset}</Button>
      <Button onPress={() => void copy()}>{student.copy}</Button>
      <Button edge onPress={() => model.requestToml()}>
        {student.save}
      </Button>
    </div>
  );
}
