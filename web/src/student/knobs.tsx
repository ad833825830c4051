// Numbers of the description that can be turned, and what to do with the result.

import { useSignal } from "@preact/signals";
import type { StudentKnob } from "../generated/wire";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { copyText, saveBlob } from "../ui/share";
import { linkTo, type StudentModel } from "./model";

export function Knobs({ model }: { model: StudentModel }) {
  const { student } = texts();
  const reply = model.reply.value;
  if (reply === null) return null;
  return (
    <section class="sec" aria-label={student.knobs}>
      <label class="field base">
        {student.base}
        <select
          value={model.setting.value.base}
          onChange={(event) => model.choose(event.currentTarget.value)}
        >
          {reply.bases.map(({ id, title }) => (
            <option key={id} value={id}>
              {title}
            </option>
          ))}
        </select>
      </label>
      <div class="knobs">
        {reply.knobs.map((knob) => (
          <Knob key={knob.key} knob={knob} model={model} />
        ))}
      </div>
    </section>
  );
}

function Knob({ knob, model }: { knob: StudentKnob; model: StudentModel }) {
  const { key, label, unit, least, most, step } = knob;
  const name = texts().student.labels[label] ?? label;
  const value = model.setting.value.knobs[key] ?? knob.value;
  const onInput = ({ currentTarget }: { currentTarget: HTMLInputElement }) => {
    const entered = currentTarget.valueAsNumber;
    if (Number.isFinite(entered)) model.turn(key, entered);
  };
  const input = { min: least, max: most, step, value: Number(value.toPrecision(6)), onInput };
  return (
    <div class="knob">
      <span aria-hidden="true">{name}</span>
      <input type="range" aria-label={name} {...input} />
      <span class="v">
        <input type="number" aria-label={`${name}, ${unit}`} {...input} />
        <span class="u">{unit}</span>
      </span>
    </div>
  );
}

export function Actions({ model }: { model: StudentModel }) {
  const { student } = texts();
  const said = useSignal("");
  model.onToml = (base, toml) => {
    saveBlob(new Blob([toml], { type: "application/toml" }), `my-${base}.toml`);
    said.value = student.saved(`my-${base}.toml`);
  };
  const copy = async () => {
    const address = linkTo(model.setting.peek(), location.href);
    said.value = (await copyText(address)) ? student.copied : address;
  };
  return (
    <div class="actions">
      <span class="said" role="status">
        {said.value}
      </span>
      <Button onPress={() => model.reset()}>{student.reset}</Button>
      <Button onPress={() => void copy()}>{student.copy}</Button>
      <Button edge onPress={() => model.requestToml()} children={student.save} />
    </div>
  );
}
