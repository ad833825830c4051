"""After a bad argument to any public method, a control can still rest and move."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import tsd_twin
from tests.support.robot_node import RunningNode, running
from tsd_twin import SimulatedRobot
from tsd_twin.client import RobotStopped
from tsd_twin.client.aio import AsyncRobotControl
from tsd_twin.client.sync import RobotControl
from tsd_twin.errors import TwinError

NAN, INF = float("nan"), float("inf")
BAD: tuple[object, ...] = (NAN, INF, -INF, "0.5", None, object(), [1.0, 2.0], "map", -1.0)
BAD_POINTS: tuple[object, ...] = ([], "ab", [(0.0, NAN)], [(1.0,)], [("0", "1")], 3.0, [3.0], None)
GOOD = {
    "duration_s": 0.1,
    "x_m": 0.1,
    "y_m": 0.0,
    "points": [(0.2, 0.0)],
    "twist_at": lambda _now_s: None,
    "rpm": 7000.0,
}
ENDINGS = {"acquire", "release", "arm", "arming", "disarm", "stop", "reset", "hand_over"}
"""Methods after which the robot is not ready or has no operator."""
UNTIMED = {"staying_ready", "driving"}
"""Iterators, whose arguments are checked on the first step."""


def methods(kind: type) -> list[str]:
    found = inspect.getmembers(kind, inspect.isfunction)
    return [name for name, _ in found if not name.startswith("_") and name not in ENDINGS]


def bad_calls(kind: type) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield each method with one wrong argument at a time."""
    for name in methods(kind):
        parameters = list(inspect.signature(getattr(kind, name)).parameters.values())[1:]
        needed = [each.name for each in parameters if each.default is inspect.Parameter.empty]
        good = {each: GOOD[each] for each in needed}
        for each in parameters:
            for value in BAD_POINTS if each.name == "points" else BAD:
                yield name, {**good, each.name: value}


CALLS = list(bad_calls(RobotControl))
ASYNC_CALLS = list(bad_calls(AsyncRobotControl))


def call(control: RobotControl, name: str, arguments: dict[str, Any]) -> None:
    result = getattr(control, name)(**arguments)
    if name in UNTIMED:
        next(iter(result), None)
        result.close()


async def call_async(control: AsyncRobotControl, name: str, arguments: dict[str, Any]) -> None:
    result = getattr(control, name)(**arguments)
    if inspect.isawaitable(result):
        await result


def test_every_method_of_a_control_is_called() -> None:
    names = {name for name, _ in CALLS}
    assert {"drive", "set_velocity", "go_to", "follow_path", "driving", "set_pose"} <= names
    assert {name for name, _ in ASYNC_CALLS} == names - UNTIMED
    without = {"rest", *(name for name in methods(RobotControl) if "turn" in name)}
    assert set(methods(RobotControl)) - names <= without


def push(base: RobotControl) -> None:
    """Set a valid velocity, or the turn rate of a sphere."""
    if base.robot.id == "atlas":
        base.set_turn_rate(wx_rad_per_s=0.1)
    else:
        base.set_velocity(vx_mps=0.1)


@pytest.mark.parametrize("robot_name", ["kiwi", "atlas"])
@pytest.mark.parametrize("name", sorted({name for name, _ in CALLS}))
def test_after_an_error_the_simulated_robot_rests_and_drives(name: str, robot_name: str) -> None:
    raised = 0
    with SimulatedRobot(robot_name) as robot, robot.control("script") as base:
        for method, arguments in CALLS:
            if method != name:
                continue
            try:
                call(base, method, arguments)
            except (TwinError, TypeError):
                raised += 1
            base.rest()
            push(base)
            base.rest()
    assert raised


@pytest.mark.parametrize(
    "call",
    [
        lambda base: base.stop(reason=5),
        lambda base: base.hand_over(asker=5),
        lambda base: base.deny(asker=5),
        lambda base: base.robot.stop(reason=5),
        lambda base: base.robot.publish_pose(NAN, 0.0, 0.0),
        lambda base: base.robot.sleep(NAN),
        lambda base: base.robot.control(5),
        lambda base: base.robot.request_control("x", timeout_s=NAN),
        lambda base: list(base.driving(lambda _now_s: (NAN, 0.0, 0.0))),
        lambda base: list(base.driving(lambda _now_s: "abc")),
    ],
)
def test_after_an_error_of_other_methods_the_robot_rests_and_drives(
    call: Callable[[Any], object],
) -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        with pytest.raises(TwinError):
            call(base)
        base.rest()
        push(base)
        base.rest()


@pytest.fixture(scope="module")
def robot_node() -> Iterator[RunningNode]:
    with running() as it:
        yield it


def _quick(calls: list[tuple[str, dict[str, object]]]) -> list[tuple[str, dict[str, object]]]:
    """Skip calls that start a motion or a request, which run the same code in real time."""
    return [
        (name, arguments)
        for name, arguments in calls
        if any(isinstance(value, float) and value != value for value in arguments.values())
        or "map" in arguments.values()
    ]


@pytest.mark.timed
def test_after_an_error_a_robot_on_the_bus_rests_and_drives(robot_node: RunningNode) -> None:
    with tsd_twin.connect(robot_node.endpoint) as robot, robot.control("script") as base:
        for name, arguments in _quick(CALLS):
            with pytest.raises((TwinError, TypeError)):
                call(base, name, arguments)
            base.rest()
        base.drive(vx_mps=0.1, duration_s=0.1)


@pytest.mark.timed
def test_after_an_error_an_asyncio_control_rests_and_drives(robot_node: RunningNode) -> None:
    async def work() -> None:
        async with (
            tsd_twin.connect_async(robot_node.endpoint) as robot,
            robot.control("script") as base,
        ):
            for name, arguments in _quick(ASYNC_CALLS):
                with pytest.raises((TwinError, TypeError)):
                    await call_async(base, name, arguments)
                await base.rest()
            await base.drive(vx_mps=0.1, duration_s=0.1)

    asyncio.run(work())


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda base: base.set_velocity(vx_mps=NAN), "vx_mps must be finite"),
        (lambda base: base.set_velocity(vx_mps="0.5"), "vx_mps must be a number, not '0.5'"),
        (lambda base: base.set_velocity(vx_mps=0.1, frame="map"), "frame must be 'base_link' or"),
        (lambda base: base.drive(vx_mps=INF, duration_s=1.0), "vx_mps must be finite"),
        (lambda base: base.drive(vx_mps=0.1, duration_s=-1.0), "duration_s must be at least 0"),
        (lambda base: base.go_to(x_m=NAN, y_m=0.0), "x_m must be finite"),
        (lambda base: base.go_to(x_m=0.1, y_m=0.0, heading_rad=NAN), "heading_rad must be finite"),
        (lambda base: base.go_to(x_m=0.1, y_m=0.0, speed_mps=0), "speed_mps must be greater"),
        (lambda base: base.follow_path([(0.0, NAN)]), "points of a path must be finite"),
        (lambda base: base.set_pose(x_m=NAN, y_m=0.0), "x_m must be finite"),
        (lambda base: base.robot.publish_pose(0.0, 0.0, NAN), "heading_rad must be finite"),
        (lambda base: base.robot.control("x", max_age_s=NAN), "max_age_s must be finite"),
    ],
)
def test_the_sentence_names_the_argument(
    call: Callable[[RobotControl], object], sentence: str
) -> None:
    with (
        SimulatedRobot("kiwi") as robot,
        robot.control("script") as base,
        pytest.raises(TwinError, match=sentence),
    ):
        call(base)


def test_rest_ends_a_motion_that_is_not_finished() -> None:
    """As when a loop over `driving`, or another thread, calls it."""
    with SimulatedRobot("kiwi") as robot, robot.control("script") as base:
        driving = base.driving(lambda _now_s: (0.2, 0.0, 0.0))
        for _ in range(10):
            next(driving)
        assert robot.state.mode == "driving"
        base.rest()
        assert robot.state.mode == "ready"
        with pytest.raises(TwinError, match=r"rest has ended this motion|in no motion"):
            next(driving)
        base.drive(vx_mps=0.1, duration_s=0.1)


def test_rest_names_a_stop_that_only_a_reset_ends() -> None:
    with SimulatedRobot("kiwi") as robot, robot.control("script") as base:
        robot.stop("cat on the track")
        with pytest.raises(RobotStopped) as stopped:
            base.rest()
        assert stopped.value.params["text"] == "cat on the track"
