"""One call releases a latched robot, and each client error names the call that helps."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator

import msgspec
import pytest

import tsd_twin
from tests.support.markdown_pages import ROOT, page, quoted, section, tables
from tsd_twin import ClientError, ControlDenied, RequestRefused, RobotStopped, SimulatedRobot
from tsd_twin.client.errors import REMEDIES
from tsd_twin.messages.codes import Code
from tsd_twin.messages.services import LeaseReply, LeaseRequest, decode_json
from tsd_twin.messages.topics import Service

FILES = sorted((ROOT / "src/tsd_twin/client").glob("*.py"))


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
        assert not any(event.why.params.get("after") == "arming" for event in seen.take())
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
        with pytest.raises(RequestRefused) as refused:
            robot.reset()
        assert (refused.value.code, refused.value.params) == ("not_latched", {"mode": "ready"})
        assert (robot.state.mode, base.is_held) == ("ready", True)
    with SimulatedRobot("tsd") as robot:
        take = LeaseRequest(op="acquire", operator="bob")
        reply = robot.link.call(Service.LEASE, msgspec.json.encode(take), 1.0)
        assert decode_json(reply or b"", LeaseReply, "a reply").granted
        robot.stop()
        robot.sleep(0.1)
        with pytest.raises(ControlDenied) as denied:
            robot.reset()
        assert denied.value.holder == "bob"
        assert denied.value.remedy.startswith("robot.request_control()")
        assert robot.state.mode == "stopped"


# Remedies.


def raised() -> Iterator[str]:
    """Yield the code of each client error raised in the sources, with * for a mode."""
    names = {each.__name__ for each in (ClientError, *subclasses(ClientError))}
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in names:
                yield from codes_of(node)


def codes_of(call: ast.Call) -> Iterator[str]:
    own = {
        "ControlDenied": ["control_denied"],
        "RequestRefused": ["arm_refused"],
        "SeveralRobotsFound": ["several_robots"],
        "StopNotConfirmed": ["stops_unconfirmed"],
    }
    name = getattr(call.func, "id", "")
    if name in own:
        yield from own[name]
    elif isinstance(code := call.args[1], ast.Constant):
        yield str(code.value)
    else:  # `robot_` plus the mode, or a code from the caller.
        yield from (f"robot_{mode}" for mode in ("stopped", "fault", "disarmed", "arming"))
        yield from ("not_ready", "stopped_by_itself")


def subclasses(of: type) -> Iterator[type]:
    for each in of.__subclasses__():
        yield each
        yield from subclasses(each)


def test_each_error_that_a_client_raises_has_a_remedy() -> None:
    codes = set(raised())
    assert len(codes) > 20
    assert codes <= REMEDIES.keys()


def test_each_remedy_belongs_to_a_code_of_a_client_or_a_robot() -> None:
    assert REMEDIES.keys() <= {*raised(), *Code}


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
    "hand over to nobody": (lambda _, base: base.hand_over(), "base.requested_by"),
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


def test_troubleshooting_has_each_code_and_its_remedy() -> None:
    (rows,) = tables(section(page("troubleshooting.md"), "## Python"))
    assert {quoted(code)[0]: remedy for code, remedy in rows} == {
        code: f"`{call}`" for code, call in REMEDIES.items()
    }


def test_refusal_has_the_code_and_the_parameters_of_the_robot() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("bob"):
        with pytest.raises(ControlDenied) as denied, robot.control("script"):
            pass
        assert (denied.value.code, denied.value.params) == ("driven_by", {"holder": "bob"})
        robot.stop("smoke")
        robot.sleep(0.1)
        with pytest.raises(RobotStopped) as stopped, robot.control("script", take_over=True):
            pass
        assert stopped.value.code == "stop_with_text"
        assert stopped.value.params["text"] == "smoke"
