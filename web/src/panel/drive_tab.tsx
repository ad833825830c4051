// Drive tab: three sprung sliders that feed the inverse kinematics, and beside them what the wheels
// do.

import { useEffect, useMemo } from "preact/hooks";
import { type Deflection, deflectionOf, isOnFloor, rotated } from "../drive/axes";
import type { Drive } from "../drive/drive";
import type { RobotInfo } from "../generated/wire";
import { GoToForm } from "../scene/goto_form";
import { useSession } from "../session";
import { isFlag, remembered } from "../store/memory";
import { whyNotDrive } from "../store/permission";
import { figure } from "../text/numbers";
import { refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Fold } from "../ui/fold";
import { Icon } from "../ui/icon";
import { Menu } from "../ui/menu";
import { Segmented } from "../ui/segmented";
import { SprungSlider, useSprungSlider } from "../ui/sprung_slider";
import { FirstDrive } from "./first_drive";
import { PanelSliders } from "./sliders";
import { WheelSpeed } from "./wheel_speed";
import { WheelsDo } from "./wheels";

/** Whether the sliders stand beside their joints, in a wide window. */
const beside = remembered("tsd-sliders-beside", false, isFlag);

export function DriveTab() {
  const { link, drive, layout } = useSession();
  const sliders = useMemo(() => new PanelSliders(drive), [drive]);
  useEffect(() => sliders.open(), [sliders]);
  const isBeside = beside.value;
  useEffect(() => {
    layout.panelWidth.value = isBeside ? "wide" : null;
    return () => (layout.panelWidth.value = null);
  }, [isBeside]);
  const robot = link.robot.value;
  const { drive: words } = texts().panel;
  if (robot === null) return <p class="note">{words.waiting}</p>;
  return (
    <div class="drive-tab">
      <FirstDrive />
      <Command sliders={sliders} robot={robot} />
      <WheelsDo preview={sliders.preview.value} />
      <div class="folds">
        {isOnFloor(robot) && (
          <Fold title={words.goTo}>
            <GoToForm />
          </Fold>
        )}
        {robot.wheel_speed_limits && (
          <WheelSpeed robot={robot} limits={robot.wheel_speed_limits} key={robot.id} />
        )}
      </div>
    </div>
  );
}

function Command({ sliders, robot }: { sliders: PanelSliders; robot: RobotInfo }) {
  const { drive: words } = texts().panel;
  const looks = sliders.looks.value;
  const axes = (["x", "y", "turn"] as const).filter((axis) => axis !== "y" || robot.sideways);
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
          value={looks ? "look" : "drive"}
          choices={[
            { value: "drive", text: words.drive },
            { value: "look", text: words.look },
          ]}
          onChoose={(value) => sliders.setLooks(value === "look")}
        />
        <Menu
          label={words.menu}
          button={<Icon name="more" />}
          class="end"
          items={[
            {
              text: words.keep,
              checked: sliders.keeps.value,
              refused: looks ? words.keepsNoLook : null,
              onChoose: () => sliders.setKeeps(!sliders.keeps.peek()),
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
        {looks ? words.looksNote : sliders.keeps.value ? words.keepsNote : words.springsNote}
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
  const looks = sliders.looks.value;
  const asked = drive.asked.value[axis];
  const scale = drive.scale.value;
  const most = axis === "turn" ? scale.turn : scale.speed;
  const refusal = link.beat.value >= 0 && !looks ? whyNotDrive(link) : null;
  const { sign, symbol, unit } = componentOf(robot, axis);
  const onFloor = isOnFloor(robot);
  const set = onFloor ? (drive.frame.value === "odom" ? words.odom : words.floor) : words.sphere;
  const allowed = looks ? reached(sliders, robot, drive) : drive.allowed.value;
  const way = words.ways[axis][asked < 0 ? 1 : 0] ?? "";
  return (
    <div class="axis">
      <div class="h">
        <b>{set[axis]}</b>
        <span>
          {sign + symbol.slice(0, 1)}
          <sub>{symbol.slice(1)}</sub> {words.inUnit(unit)}
        </span>
      </div>
      <SprungSlider
        label={set[axis]}
        control={control}
        asked={asked}
        allowed={drive.held.value ? (allowed?.[axis] ?? null) : null}
        most={most}
        spoken={asked === 0 ? words.zero : words.spoken(figure(Math.abs(asked), 2), unit, way)}
        mirrored={mirrored}
        off={looks ? link.recording !== null : refusal !== null}
        refused={refusal && refusalText(refusal)}
        looksOnly={looks}
      />
    </div>
  );
}

/** Deflection that the limits leave of the one that is looked at, along the axes of the controls. */
function reached(sliders: PanelSliders, robot: RobotInfo, drive: Drive): Deflection | null {
  const preview = sliders.preview.value;
  if (preview === null) return null;
  const heading = drive.frame.value === "odom" ? (drive.link.state.value?.pose?.[2] ?? 0) : 0;
  return rotated(deflectionOf(robot, preview.twist), heading);
}

/** Component of the twist behind an axis of the controls; ahead, a sphere turns about Y. */
function componentOf(robot: RobotInfo, axis: keyof Deflection) {
  const onFloor = isOnFloor(robot);
  const index = { x: onFloor ? 0 : 1, y: onFloor ? 1 : 0, turn: 2 }[axis];
  const { symbol = "", unit = "" } = robot.twist_axes[index] ?? {};
  return { sign: axis === "y" && !onFloor ? "−" : "", symbol, unit };
}
