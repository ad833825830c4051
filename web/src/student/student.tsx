// Student tab: turn the knobs of a robot that is not there, and see what follows, from the twist to
// the joints and from the joints to the twist. No robot moves.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { StudentKnob } from "../generated/wire";
import { useSession } from "../session";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { copyText, saveBlob } from "../ui/share";
import { type StudentModel, linkTo } from "./model";
import { Capabilities, Equations, Papers, outcome } from "./results";
import { Sketch } from "./sketch";
import { Joints, Twist } from "./sliders";
import "./student.css";

export function Student() {
  const { student: model } = useSession();
  const { student } = texts();
  useEffect(() => {
    model.show(true);
    return () => model.show(false);
  }, [model]);
  const reply = model.reply.value;
  const figures = reply?.figures;
  return (
    <div class="student">
      <p class="note">{student.intro}</p>
      {reply?.problem && (
        <p class="problem" role="alert">
          {student.impossible(reply.problem)}
        </p>
      )}
      {figures ? (
        <>
          <div class="cols3">
            <Twist model={model} figures={figures} />
            <Sketch figures={figures} />
            <Joints model={model} figures={figures} />
          </div>
          <p>{outcome(figures)}</p>
          <Equations {...figures} />
        </>
      ) : (
        <p role="status">{student.waiting}</p>
      )}
      <Knobs model={model} />
      <Actions model={model} />
      {figures && <Capabilities {...figures} />}
      {reply && reply.papers.length > 0 && <Papers {...reply} />}
    </div>
  );
}

function Knobs({ model }: { model: StudentModel }) {
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

function Actions({ model }: { model: StudentModel }) {
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
