"""One call releases a latched robot, and each error of the client names the call that helps."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator

import pytest

import tsd_twin
from tests.support.markdown_pages import ROOT, page, quoted, section, tables
from tsd_twin import ClientError, ControlDenied, RequestRefused, RobotStopped, SimulatedRobot
from tsd_twin.errors import REMEDIES, remedy_of

FILES = sorted((ROOT / "src/tsd_twin/client").glob("*.py"))
ROBOTS_OWN = ("safety/supervisor.py", "safety/lease.py", "control/services.py")


# A latched robot.


@pytest.mark.parametrize("latch", ["stop", "fault"])
def test_a_latched_robot_is_released_without_arming_and_without_keeping_control(
    latch: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SimulatedRobot("tsd") as robot:
        if latch == "stop":
            robot.stop("smoke")
        else:
            with robot.control("script"), monkeypatch.context() as broken:
                broken.setattr(robot.link.simulated, "read", lambda _: None)
                robot.sleep(0.2)
            assert robot.state.mode == "fault"
        with pytest.raises(RobotStopped) as refused, robot.control("script"):
            pass
        assert refused.value.remedy == "robot.reset()"
        seen = robot.events()
        robot.reset()
        assert robot.state.mode == "disarmed"
        robot.sleep(0.1)
        assert robot.state.lease.holder is None
        assert not any("arming" in event.text for event in seen.take())
        with robot.control("script") as base:
            base.drive(vx_mps=0.1, duration_s=0.1)


def test_a_stop_under_ones_own_control_is_released_under_it() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        robot.stop()
        robot.sleep(0.1)
        robot.reset()
        assert base.is_held
        base.arm()
        base.drive(vx_mps=0.1, duration_s=0.1)


def test_a_stop_just_sent_is_released_too() -> None:
    with SimulatedRobot("tsd") as robot:
        robot.stop()
        robot.reset()
        assert robot.state.mode == "disarmed"


def test_a_reset_takes_control_from_nobody_and_changes_no_robot_that_is_not_latched() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("bob") as base:
        with pytest.raises(RequestRefused, match="the robot is ready, not stopped"):
            robot.reset()
        assert (robot.state.mode, base.is_held) == ("ready", True)
        base._protocol.release()
        base._link.detach(base._protocol)
        robot.stop()
        robot.sleep(0.1)
        with pytest.raises(ControlDenied) as denied:
            robot.reset()
        assert denied.value.holder == "bob"
        assert denied.value.remedy.startswith("robot.request_control()")
        assert robot.state.mode == "stopped"


# Remedies.


def raised() -> Iterator[str]:
    """Yield the sentence of each `raise` of a client error; ... marks inserted text."""
    names = {each.__name__ for each in (ClientError, *subclasses(ClientError))}
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            call = node.exc if isinstance(node, ast.Raise) else None
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") in names:
                yield text_of(call)


def text_of(call: ast.Call) -> str:
    before = {
        "ControlDenied": "... gives no control: ",
        "RequestRefused": "... refuses to ... ",
        "SeveralRobotsFound": "name one, connect(robot=",
        "StopNotConfirmed": "no confirmed stop of ",
    }
    parts: list[str] = [before.get(getattr(call.func, "id", ""), "")]
    for argument in call.args:
        for node in ast.walk(argument):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                parts.append(node.value)
            elif isinstance(node, ast.Name) and node.id == "_HINT":
                parts.append("no robot")
    return "...".join(parts).replace("refuses to ... ...", "refuses to ")


def subclasses(of: type) -> Iterator[type]:
    for each in of.__subclasses__():
        yield each
        yield from subclasses(each)


def test_each_error_that_a_client_raises_has_a_remedy() -> None:
    sentences = set(raised())
    assert len(sentences) > 20
    of_the_robot = {"... refuses to ... "}  # Its own sentence follows; see the next test.
    assert {text for text in sentences if not remedy_of(text)} == of_the_robot


def test_each_remedy_belongs_to_a_sentence_that_a_client_or_a_robot_says() -> None:
    files = [*FILES, *(ROOT / "src/tsd_twin" / name for name in ROBOTS_OWN)]
    files += [
        ROOT / "src/tsd_twin/robots/description.py",
        ROOT / "src/tsd_twin/messages/requests.py",
        ROOT / "src/tsd_twin/errors.py",
    ]
    said = "\n".join(file.read_text(encoding="utf-8") for file in files)
    said = said.replace("REMEDIES", "", 1)
    said = re.sub(r'"\s*\n\s*f?"', "", re.sub(r"REMEDIES: .*?\n}\n", "", said, flags=re.DOTALL))
    modes = {"is stopped", "is fault", "is disarmed", "is arming", "is ready already"}
    missing = {
        part for part in REMEDIES if not all(words.strip() in said for words in part.split("..."))
    }
    assert missing <= modes, "a mode is filled in"


def stop_first(robot: SimulatedRobot) -> None:
    robot.stop()
    robot.sleep(0.1)


REFUSED: dict[str, tuple[Callable[[SimulatedRobot, tsd_twin.RobotControl], object], str]] = {
    "arm a latched robot": (
        lambda robot, base: (stop_first(robot), base.arm()),
        "robot.reset()",
    ),
    "drive a latched robot": (
        lambda robot, base: (stop_first(robot), base.drive(vx_mps=0.1, duration_s=0.1)),
        "robot.reset()",
    ),
    "drive a disarmed robot": (
        lambda _, base: (base.disarm(), base.drive(vx_mps=0.1, duration_s=0.1)),
        "base.arm()",
    ),
    "reset a ready robot": (lambda _, base: base.reset(), "base.arm()"),
    "set a pose that is no number": (
        lambda _, base: base.set_pose(x_m=float("nan"), y_m=0.0),
        "the same call with finite numbers",
    ),
    "a wheel speed": (lambda _, base: base.set_wheel_speed(1e6), "base.set_wheel_speed("),
    "hand over to nobody": (lambda _, base: base.hand_over(), "base.asked_by"),
    "turn a robot on a floor": (
        lambda _, base: base.turn(wx_rad_per_s=0.1, duration_s=0.1),
        "base.drive(",
    ),
    "drive after a release": (
        lambda _, base: (base.release(), base.drive(vx_mps=0.1, duration_s=0.1)),
        "base.acquire()",
    ),
}


@pytest.mark.parametrize("what", list(REFUSED))
def test_what_is_refused_names_the_call_that_resolves_it_in_attribute_and_traceback(
    what: str,
) -> None:
    attempt, call = REFUSED[what]
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        with pytest.raises(ClientError) as caught:
            attempt(robot, base)
        assert caught.value.remedy.startswith(call)
        assert caught.value.__notes__ == [f"Remedy: {caught.value.remedy}"]


def test_troubleshooting_has_each_sentence_and_its_remedy() -> None:
    (rows,) = tables(section(page("troubleshooting.md"), "## Python"))
    told = {quoted(message)[0]: remedy for message, remedy in rows}
    assert {part: call for part, call in REMEDIES.items() if f"`{call}`" != told.get(part)} == {}
