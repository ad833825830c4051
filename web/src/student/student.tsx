// Student tab: turn the knobs of a robot that is not there, and see what follows, from the twist to
// the joints and from the joints to the twist. No robot moves.

import { useEffect, useMemo } from "preact/hooks";
import type { StudentFigures } from "../generated/wire";
import { type Session, useSession } from "../session";
import { figure } from "../text/numbers";
import { Quantity } from "../ui/figure";
import { texts } from "../text/text";
import { Fold } from "../ui/fold";
import { PaperPlot, ReachPlot } from "./curves";
import { decimalsOf, Equations } from "./equations";
import { KnobSlider } from "./knob_slider";
import { Actions, Knobs } from "./knobs";
import { StudentModel } from "./model";
import { Sketch } from "./sketch";
import "./student.css";

const models = new WeakMap<Session, StudentModel>();

/** The model outlives the tab, so that the setting is still there when the tab is opened again. */
function modelOf(session: Session): StudentModel {
  const model = models.get(session) ?? new StudentModel(session.link, location.search);
  models.set(session, model);
  return model;
}

export function Student() {
  const session = useSession();
  const model = useMemo(() => modelOf(session), [session]);
  const { student } = texts();
  useEffect(() => {
    model.show(true);
    return () => model.show(false);
  }, [model]);
  const reply = model.reply.value;
  const figures = reply?.figures ?? null;
  return (
    <div class="student">
      <p class="note">{student.intro}</p>
      {reply && reply.problem !== "" && (
        <p class="problem" role="alert">
          {student.impossible(reply.problem)}
        </p>
      )}
      {figures === null ? (
        <p role="status">{student.waiting}</p>
      ) : (
        <>
          <div class="cols3">
            <Twist model={model} figures={figures} />
            <Sketch figures={figures} />
            <Joints model={model} figures={figures} />
          </div>
          <Outcome figures={figures} />
          <Equations equations={figures.equations} />
        </>
      )}
      <Knobs model={model} />
      <Actions model={model} />
      {figures && <Capabilities figures={figures} />}
      {reply && reply.papers.length > 0 && (
        <Fold title={student.paperFigures}>
          <div class="plots-row">
            {reply.papers.map((paper) => (
              <PaperPlot key={paper.name} paper={paper} />
            ))}
          </div>
        </Fold>
      )}
    </div>
  );
}

interface PartProps {
  model: StudentModel;
  figures: StudentFigures;
}

/** Round up to two digits, so that the ends of a slider are plain numbers. */
function roundEnd(value: number): number {
  const step = 10 ** Math.floor(Math.log10(Math.max(value, 1e-9)) - 1);
  return Number((Math.ceil(value / step - 1e-9) * step).toPrecision(6));
}

function Twist({ model, figures }: PartProps) {
  const { student } = texts();
  const { joints, twist } = model.setting.value;
  const shown = joints === null ? twist : figures.twist;
  return (
    <section class="sec" aria-label={student.twist}>
      <h2>
        {student.twist} <small>{student.toJoints}</small>
      </h2>
      {figures.axes.map(({ name, symbol, unit }, i) => (
        <div class="axis" key={name}>
          <div class="h">
            <b>{student.axes[name] ?? symbol}</b>
            <span>
              <Quantity symbol={symbol} /> {student.inUnit("", unit).trim()}
            </span>
          </div>
          <KnobSlider
            label={student.axes[name] ?? symbol}
            value={shown[i] ?? 0}
            most={roundEnd(figures.tops[i] ?? 1)}
            decimals={2}
            unit={unit}
            follows={joints !== null}
            ends
            onTurn={(value) => model.move(i, value)}
          />
        </div>
      ))}
    </section>
  );
}

function Joints({ model, figures }: PartProps) {
  const { student } = texts();
  const { joints, knobs } = model.setting.value;
  const rows = joints ?? model.joints();
  const isGimbal = figures.wheels[0]?.gimbal != null;
  const tiltKnob = model.reply.value?.knobs.find(({ key }) => key.endsWith("max_tilt_deg"));
  const tilt = knobs[tiltKnob?.key ?? ""] ?? tiltKnob?.value ?? 30;
  const fastest = Math.max(1, ...rows.map((row) => Math.abs(row.at(-1) ?? 0)));
  // The range must not move under a hand that drags.
  const usual = useMemo(() => roundEnd(2 * fastest), [figures.wheels.length, isGimbal]);
  const columns = isGimbal ? ["α", "β"] : ["φ̇"];
  const unit = isGimbal ? "°" : "rpm";
  const most = isGimbal ? tilt : Math.max(usual, fastest);
  return (
    <section class="sec" aria-label={student.joints}>
      <h2>
        {student.joints} <small>{student.toTwist}</small>
      </h2>
      <div class={isGimbal ? "gim" : "gim one"}>
        <span />
        {columns.map((column) => (
          <span class="h" key={column}>
            {student.inUnit(column, unit)}
          </span>
        ))}
        {rows.map((row, i) => [
          <b key={`n${i}`}>{i + 1}</b>,
          ...columns.map((column, j) => (
            <KnobSlider
              key={`${i} ${column}`}
              label={student.jointOf(column, i + 1)}
              value={row[j] ?? 0}
              most={most}
              decimals={isGimbal ? 1 : 0}
              unit={unit}
              follows={joints === null}
              onTurn={(value) => model.bend(i, j, value)}
            />
          )),
        ])}
      </div>
      <p class="note">{contradiction(figures)}</p>
    </section>
  );
}

function contradiction({ redundancy, residual_mps }: StudentFigures): string {
  const { student } = texts();
  if (redundancy === 0) return student.noContradiction;
  if (residual_mps === 0) return student.tryContradiction;
  return student.contradiction(figure(1000 * residual_mps, 1));
}

/** Utilization of the joint limits, and the largest twist in the same direction. */
function Outcome({ figures }: { figures: StudentFigures }) {
  const { student } = texts();
  const { axes, twist, utilization: share } = figures;
  if (share === 0) return <p class="outcome">{student.atRest}</p>;
  const most = axes.map(({ symbol, unit }, i) => {
    const part = ((twist[i] ?? 0) * Math.max(1, share)) / share;
    return `${symbol} ${figure(part, 2)} ${unit}`;
  });
  return (
    <p class="outcome">
      {student.share(figure(100 * share), share > 1)} {student.most(most.join(", "))}
    </p>
  );
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
          <ReachPlot key={i} outline={outline} figures={figures} />
        ))}
      </div>
    </Fold>
  );
}
