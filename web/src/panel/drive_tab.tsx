// Drive tab: three sprung sliders that feed the inverse kinematics, and the
// resulting motion of the wheels.

import { useEffect, useMemo } from "preact/hooks";
import { type Deflection, deflectionOf, isOnFloor, rotated } from "../drive/axes";
import type { RobotInfo } from "../generated/wire";
import { useSession } from "../session";
import { currentState } from "../store/freshness";
import { whyNotDrive, whyNotPlan } from "../store/permission";
import { refusalText } from "../text/reasons";
import { degrees, figure, texts } from "../text/text";
import { Button } from "../ui/button";
import { Quantity } from "../ui/figure";
import { Fold } from "../ui/fold";
import { Icon } from "../ui/icon";
import { Menu } from "../ui/menu";
import { Segmented } from "../ui/segmented";
import { SprungSlider, useSprungSlider } from "../ui/sprung_slider";
import { FirstDrive } from "./first_drive";
import { PanelSliders } from "./sliders";
import { WheelSpeed } from "./wheel_speed";
import { WheelsDo } from "./wheels";

export function DriveTab() {
  const { link, drive } = useSession();
  const sliders = useMemo(() => new PanelSliders(drive), [drive]);
  useEffect(() => sliders.open(), [sliders]);
  const robot = link.robot.value;
  const { drive: words } = texts().panel;
  if (robot === null) return <p class="note">{words.waiting}</p>;
  // Nothing drives a recording.
  if (link.recording !== null) return <WheelsDo preview={null} />;
  return (
    <div class="drive-tab">
      <FirstDrive />
      <Command sliders={sliders} robot={robot} />
      <WheelsDo preview={sliders.preview.value} />
      <div class="folds">
        <GoToForm />
        {robot.wheel_speed_limits && (
          <WheelSpeed robot={robot} limits={robot.wheel_speed_limits} key={robot.id} />
        )}
      </div>
    </div>
  );
}

function Command({ sliders, robot }: { sliders: PanelSliders; robot: RobotInfo }) {
  const { beside } = useSession().layout;
  const { drive: words } = texts().panel;
  const mode = sliders.mode.value;
  const axes = robot.sideways ? (["x", "y", "turn"] as const) : (["x", "turn"] as const);
  const key = (event: KeyboardEvent) => event.code === "Home" && sliders.zero();
  return (
    <section class="sec" onPointerCancel={() => sliders.zero()} onKeyDown={key}>
      <h2 class="sr">{words.title}</h2>
      {axes.map((axis) => (
        <Axis key={axis} axis={axis} sliders={sliders} robot={robot} />
      ))}
      <div class="switch">
        <Segmented
          label={words.effect}
          value={mode === "looks" ? "looks" : "springs"}
          choices={{ springs: words.drive, looks: words.look }}
          onChoose={(value) => sliders.choose(value)}
        />
        <Menu
          label={words.menu}
          button={<Icon name="more" />}
          items={[
            {
              text: words.keep,
              checked: mode === "keeps",
              refused: mode === "looks" ? words.keepsNoLook : null,
              onChoose: () => sliders.choose(mode === "keeps" ? "springs" : "keeps"),
            },
            {
              text: words.beside,
              checked: beside.value,
              onChoose: () => (beside.value = !beside.peek()),
            },
          ]}
        />
      </div>
      <p class="note" role="status">
        {words.notes[mode]}
      </p>
    </section>
  );
}

interface AxisProps {
  axis: keyof Deflection;
  sliders: PanelSliders;
  robot: RobotInfo;
}

function Axis({ axis, sliders, robot }: AxisProps) {
  const { link, drive } = useSession();
  const { drive: words } = texts().panel;
  const mirrored = axis !== "x"; // Left is on the left.
  const control = useSprungSlider(sliders, axis, mirrored);
  const looks = sliders.mode.value === "looks";
  const refusal = looks ? null : whyNotDrive(link);
  const asked = drive.asked.value[axis];
  const { speed, turn } = drive.scale.value;
  const onFloor = isOnFloor(robot);
  const onOdom = drive.frame.value === "odom";
  const name = words[onFloor ? (onOdom ? "odom" : "floor") : "sphere"][axis];
  // Ahead, a sphere turns about Y; to the left, about minus X.
  const component = { x: onFloor ? 0 : 1, y: onFloor ? 1 : 0, turn: 2 }[axis];
  const { symbol = "", unit = "" } = robot.twist_axes[component] ?? {};
  const way = words.ways[axis][asked < 0 ? 1 : 0] ?? "";
  const twist = looks ? sliders.preview.value?.twist : null;
  const heading = onOdom ? (link.state.value?.pose?.[2] ?? 0) : 0;
  const looked = twist ? rotated(deflectionOf(robot, twist), heading) : null;
  const allowed = drive.held.value ? (looks ? looked : drive.allowed.value) : null;
  return (
    <div class="axis">
      <div class="h">
        <b>{name}</b>
        <span>
          {axis === "y" && !onFloor && "−"}
          <Quantity symbol={symbol} /> {words.inUnit(unit)}
        </span>
      </div>
      <SprungSlider
        label={name}
        control={control}
        asked={asked}
        allowed={allowed?.[axis] ?? null}
        most={axis === "turn" ? turn : speed}
        spoken={asked === 0 ? words.zero : words.spoken(figure(Math.abs(asked), 2), unit, way)}
        mirrored={mirrored}
        refused={refusal && refusalText(refusal)}
        looksOnly={looks}
      />
    </div>
  );
}

const MOST = 10_000; // Limit of a message.

/** Goal in numbers. It plans; the path is then followed by holding G or the deck's button. */
export function GoToForm() {
  const { link, path } = useSession();
  const { form: words } = texts().scene;
  if (!isOnFloor(link.robot.value)) return null;
  const pose = currentState(link)?.pose;
  const refusal = whyNotPlan(link);
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (refusal !== null || !pose) return;
    const typed = new FormData(event.currentTarget as HTMLFormElement);
    const numberOf = (name: string) => (typed.get(name) === "" ? null : Number(typed.get(name)));
    const heading = numberOf("heading");
    path.plan({
      kind: "to",
      on: "floor",
      points: [[numberOf("x") ?? pose[0], numberOf("y") ?? pose[1]]],
      heading: heading === null ? null : (heading * Math.PI) / 180,
    });
  };
  const route = path.route.value;
  const next = route?.phase === "planned" ? words.planned(figure(route.length_m, 2)) : words.hint;
  const fields = {
    x: figure(pose?.[0], 2),
    y: figure(pose?.[1], 2),
    heading: figure(degrees(pose?.[2])),
  };
  return (
    <Fold title={texts().panel.drive.goTo}>
      <form class="goto" aria-label={words.label} onSubmit={submit}>
        {(["x", "y", "heading"] as const).map((name) => (
          <label key={name}>
            {words[name]}
            <span class="field">
              <input
                type="number"
                name={name}
                step="any"
                min={-MOST}
                max={MOST}
                inputMode="decimal"
                placeholder={fields[name]}
              />
            </span>
          </label>
        ))}
        <Button edge submit refused={refusal && refusalText(refusal)} children={words.plan} />
        <p class="note" role="status">
          {refusal ? refusalText(refusal) : next}
        </p>
      </form>
    </Fold>
  );
}
