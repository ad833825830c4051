// Student tab: turn the knobs of a robot that is not there, and see what follows, from the twist to
// the joints and from the joints to the twist. No robot moves.

import { useEffect } from "preact/hooks";
import { useSession } from "../session";
import { texts } from "../text/text";
import { Actions, Knobs } from "./knobs";
import { Capabilities, Equations, outcome, Papers } from "./results";
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
