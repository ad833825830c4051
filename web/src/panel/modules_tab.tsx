// Modules tab: measured values and set-points of each module or wheel, and whether they agree; for a
// sphere its marks, both contact models, and turns that bring a mark to the top.

import { onScreen } from "../drive/axes";
import { turned } from "../drive/sphere";
import type { RobotState, SphereState } from "../generated/wire";
import { useSession } from "../session";
import { whyNotDrive } from "../store/permission";
import { refusalText } from "../text/reasons";
import { figure, texts } from "../text/text";
import { Button } from "../ui/button";
import { REACH, Ring } from "./dial";
import type { Actuator, Shown } from "./table";
import { Table, Values, actuatorsOf, poseRows, quantity, useShown, value } from "./table";

const SHUT_OFF = new Set(["disarmed", "stopped", "fault"]);
const OFF_DEG = 0.5; // A gimbal that is farther from its set-point does not follow.

export function ModulesTab() {
  const { drive, modules: words } = texts().panel;
  const shown = useShown();
  if (shown === null) return <p class="note">{drive.waiting}</p>;
  const { robot, state } = shown;
  const isGimbals = robot.panel === "gimbals";
  return (
    <>
      {(isGimbals || robot.panel === "wheels") && <Agreement {...shown} />}
      {robot.wheels.length > 0 && <Wheels {...shown} />}
      {isGimbals && (
        <div class="modules">
          {actuatorsOf(shown).map((actuator) => (
            <Gimbal key={actuator.id} state={state} actuator={actuator} />
          ))}
        </div>
      )}
      {isGimbals && <p class="note">{words.directions}</p>}
      {!isGimbals && robot.wheels.length === 0 && <Values {...shown} />}
      {robot.panel === "sphere" && <Sphere sphere={state?.sphere ?? null} />}
      {robot.not_promised.length > 0 && (
        <section class="sec">
          <h2>{words.notPromised}</h2>
          <ul class="points">
            {robot.not_promised.map((sentence) => (
              <li key={sentence}>{sentence}</li>
            ))}
          </ul>
        </section>
      )}
    </>
  );
}

function Gimbal({ state, actuator }: { state: RobotState | null; actuator: Actuator }) {
  const { modules: words, wheels } = texts().panel;
  const { id, name, measured, goal } = actuator;
  const { suspect, contributions } = state?.status.consistency ?? {};
  const share = contributions?.[id];
  const phase = measured && (measured.spinning ? words.spinning : words.atRest);
  const rows = [
    ...poseRows([measured, goal], true),
    quantity(words.direction, "°", 0, measured?.direction, goal?.direction),
    [...quantity(words.radius, "mm", 1, measured?.radius_mm), ""],
    [...quantity(words.share, "%", 0, share && 100 * share), ""],
  ];
  return (
    <section class={suspect === id ? "sec suspect" : "sec"}>
      <h2>
        {name}
        <small>{suspect === id ? words.suspect : phase}</small>
      </h2>
      <Table label={name} heads={["", wheels.measured, wheels.setPoint]} rows={rows} />
    </section>
  );
}

function Wheels(shown: Shown) {
  const { modules: words, wheels } = texts().panel;
  const suspect = shown.state?.status.consistency.suspect;
  const rows = actuatorsOf(shown).map(({ id, name, measured, goal }) => [
    <span class={suspect === id ? "suspect" : ""}>{name}</span>,
    value(measured?.rpm, 0, wheels.rpm),
    value(goal?.rpm, 0, wheels.rpm),
    value(measured?.residual_mps, 3, "m/s"),
  ]);
  const heads = ["", wheels.measured, wheels.setPoint, words.unexplained];
  return <Table label={wheels.title} heads={heads} rows={rows} />;
}

/** Whether the actuators agree on one motion, and which of them does not. */
function Agreement(shown: Shown) {
  const { agreement, unexplained } = texts().panel.modules;
  const { residual_mps, suspect, level = 0 } = shown.state?.status.consistency ?? {};
  return (
    <section class={suspect || level > 1 ? "sec suspect" : "sec"}>
      <h2>
        {agreement}
        <small>
          {unexplained} {value(residual_mps, 3, "m/s")}
        </small>
      </h2>
      <p>{verdictOf(shown)}</p>
    </section>
  );
}

function verdictOf(shown: Shown): string | null {
  const { modules: words } = texts().panel;
  const { robot, state } = shown;
  if (state === null) return null;
  const { suspect, level } = state.status.consistency;
  if (suspect === null) {
    if (level > 1) return words.oneContradicts;
    if (robot.panel === "gimbals") return words.modulesAgree;
    return robot.wheels.length < 4 ? words.threeWheels : words.wheelsAgree;
  }
  const found = actuatorsOf(shown).find(({ id }) => id === suspect);
  const name = found?.name ?? suspect;
  const off = (angle: "alpha" | "beta") =>
    Math.abs((found?.measured?.[angle] ?? 0) - (found?.goal?.[angle] ?? 0));
  const [gimbal, offDeg] = off("beta") > off("alpha") ? ["β", off("beta")] : ["α", off("alpha")];
  if (offDeg < OFF_DEG) return words.contradicts(name);
  const end = SHUT_OFF.has(state.status.mode) ? words.shutOff : words.pushes;
  return `${words.doesNotFollow(name, gimbal, figure(offDeg, 1))} ${end}`;
}

const MARKS = [
  ["front", [1, 0, 0]],
  ["back", [-1, 0, 0]],
  ["left", [0, 1, 0]],
  ["right", [0, -1, 0]],
  ["top", [0, 0, 1]],
  ["bottom", [0, 0, -1]],
] as const;

function Sphere({ sphere }: { sphere: SphereState | null }) {
  const { link, sphere: turn } = useSession();
  const { sphere: words } = texts().panel;
  const refusal = whyNotDrive(link);
  return (
    <section class="sec">
      <h2>{words.title}</h2>
      <div class="globe">
        <Ring label={words.picture}>
          {sphere &&
            MARKS.map(([name, at]) => {
              const [x, y, z] = turned(sphere.wxyz, at);
              const { right, down } = onScreen({ x: REACH * x, y: REACH * y });
              const below = z < 0 ? "below" : "";
              return (
                <circle key={name} class={`mark ${name} ${below}`} r="5" cx={right} cy={down} />
              );
            })}
        </Ring>
        <Table
          label={words.models}
          heads={["rad/s", words.ideal, words.dual]}
          rows={["ωx", "ωy", "ωz"].map((name, i) =>
            quantity(name, "", 2, sphere?.ideal[i], sphere?.dual?.[i]),
          )}
        />
      </div>
      {typeof sphere?.angle_deg === "number" && (
        <p>{words.between(figure(sphere.angle_deg, 2), figure(sphere.magnitude_percent, 2))}</p>
      )}
      {sphere?.rows.some((row) => row > 0) && (
        <p>{words.rows(sphere.rows.map((row) => words.row[row] ?? "–").join(", "))}</p>
      )}
      <p>{words.bringHint}</p>
      <div class="bring" role="group" aria-label={words.bring}>
        {MARKS.map(([name, at]) => (
          <Button
            key={name}
            edge
            refused={refusal && refusalText(refusal)}
            onPress={() => turn.bring(at)}
          >
            {words.marks[name]}
          </Button>
        ))}
      </div>
    </section>
  );
}
