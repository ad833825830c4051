// Student tab: turn the knobs of a robot that is not there, and see what follows, from the twist to
// the joints and from the joints to the twist. No robot moves.

import { useEffect } from "preact/hooks";
import type { StudentFigures } from "../generated/wire";
import { useSession } from "../session";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { Fold } from "../ui/fold";
import { paperPlot, PlotFigure, reachPlot } from "./curves";
import { decimalsOf, Equations } from "./equations";
import { Actions, Knobs } from "./knobs";
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
          <Equations equations={figures.equations} />
        </>
      ) : (
        <p role="status">{student.waiting}</p>
      )}
      <Knobs model={model} />
      <Actions model={model} />
      {figures && <Capabilities figures={figures} />}
      {reply && reply.papers.length > 0 && (
        <Fold title={student.paperFigures}>
          <div class="plots-row">
            {reply.papers.map((paper) => (
              <PlotFigure key={paper.name} {...paperPlot(paper)} />
            ))}
          </div>
        </Fold>
      )}
    </div>
  );
}

/** Utilization of the joint limits, and the largest twist in the same direction. */
function outcome({ axes, twist, utilization: share }: StudentFigures): string {
  const { student } = texts();
  if (share === 0) return student.atRest;
  const most = axes.map(({ symbol, unit }, i) => {
    const part = ((twist[i] ?? 0) * Math.max(1, share)) / share;
    return `${symbol} ${figure(part, 2)} ${unit}`;
  });
  return `${student.share(figure(100 * share), share > 1)} ${student.most(most.join(", "))}`;
}

function Capabilities({ figures }: { figures: StudentFigures }) {
  const { student } = texts();
  return (
    <Fold title={student.figures}>
      <dl class="results">
        {figures.figures.map(({ name, value, unit, note }) => (
          <div key={name}>
            <dt>
              {student.labels[name] ?? name} {note && <span class="note">{note}</span>}
            </dt>
            <dd>
              {figure(value, decimalsOf(value))}
              <span class="u">{unit}</span>
            </dd>
          </div>
        ))}
      </dl>
      <p class="note">{student.reachHint}</p>
      <div class="plots-row">
        {figures.outlines.map((outline, i) => (
          <PlotFigure key={i} {...reachPlot(outline, figures.axes)} />
        ))}
      </div>
    </Fold>
  );
}
