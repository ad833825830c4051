// Bar: which robot, what it does, who drives, and how good link and battery are.

import { useEffect } from "preact/hooks";
import { useSession } from "../session";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import { Menu } from "../ui/menu";
import { NameDialog, OwnName, Sheet, TakeOver, useLogin } from "./dialogs";
import { Actions, Question, Who } from "./driver";
import { Battery, FleetLink, LinkFact, Mode, withHash } from "./facts";
import "./bar.css";

export function Bar() {
  const { layout, link, keyboard } = useSession();
  const { dialog } = layout;
  const { bar } = texts();
  useLogin(link);
  const toggle = () => (dialog.value = dialog.peek() === "sheet" ? null : "sheet");
  useEffect(() => keyboard.bind({ "?": toggle }), [keyboard]);
  const isFleet = layout.screen.value === "fleet";
  return (
    <header class="bar">
      {isFleet ? <FleetTitle /> : <OfRobot />}
      <Button class="roomy" onPress={() => (dialog.value = "name")}>
        <OwnName />
      </Button>
      {!isFleet && <FleetLink />}
      <Button icon="help" label={bar.help} onPress={toggle} />
      {dialog.value === "sheet" && <Sheet />}
      {dialog.value === "name" && <NameDialog />}
      {dialog.value === "takeover" && <TakeOver />}
    </header>
  );
}

function OfRobot() {
  const { gamepad, layout, link } = useSession();
  const { bar } = texts();
  return (
    <>
      <RobotMenu />
      <Mode />
      {link.recording !== null && (
        <bdi class="fact roomy" title={link.recording}>
          {link.recording}
        </bdi>
      )}
      {!layout.phone.value && <Who />}
      {!layout.phone.value && <Actions />}
      <Question />
      <span class="spacer" />
      {gamepad.name.value !== null && link.recording === null && (
        <Button
          class="fact pad"
          icon="gamepad"
          label={bar.gamepad}
          onPress={() => (layout.dialog.value = "sheet")}
        >
          <span>{bar.gamepad}</span>
        </Button>
      )}
      <LinkFact />
      <Battery />
    </>
  );
}

function FleetTitle() {
  const id = useSession().link.robot.value?.id;
  const { bar } = texts();
  return (
    <>
      <span class="who">{bar.fleet}</span>
      <a class="btn edge" href={withHash("")}>
        {id === undefined ? bar.backToRobot : bar.back(id)}
      </a>
      <span class="spacer" />
    </>
  );
}

function RobotMenu() {
  const { link } = useSession();
  const { bar } = texts();
  const robots = link.welcome.value?.robots ?? [];
  const robot = link.robot.value;
  if (robot === null) return null;
  const named = (id: string) => (
    <>
      <span class="dot" style={{ "--c": robots.find((each) => each.id === id)?.colour }} />
      <bdi title={id}>{id}</bdi>
    </>
  );
  const shown = named(robot.id);
  if (robots.length < 2)
    return (
      <span class="who" title={robot.title}>
        {shown}
      </span>
    );
  const items = robots.map(({ id, title }) => ({
    text: [named(id), <span class="note">{title}</span>],
    checked: id === robot.id,
    onChoose: () => id !== robot.id && link.choose(id),
  }));
  const button = [shown, <Icon name="down" />];
  return <Menu class="who" label={bar.chooseRobot(robot.id)} button={button} items={items} />;
}
