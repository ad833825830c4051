"""The client over a real bus with a real node: threads, processes, event loops."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator

import pytest

import tsd_twin
from tests.support.robot_node import ANY_PORT, QUICK, RunningNode, running
from tests.support.withheld import PATIENCE_S, Stopwatch, WithheldTime
from tsd_twin import (
    ControlDenied,
    ControlLost,
    NoRobotFound,
    RobotSilent,
    RobotStopped,
    SeveralRobotsFound,
)
from tsd_twin.bus import Bus, node_config
from tsd_twin.client.protocol import COMMAND_PERIOD_S
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.simulation import SimRobot

pytestmark = pytest.mark.timed


@pytest.fixture
def robot(node: RunningNode) -> Generator[tsd_twin.RobotClient]:
    with tsd_twin.connect(node.endpoint) as robot:
        yield robot


def wait_for(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_a_drive_ends_at_rest_disarmed_and_free(robot: tsd_twin.RobotClient) -> None:
    assert robot.state.mode == "disarmed"
    with robot.control("script") as base:
        assert robot.state.mode == "ready"
        assert robot.state.lease.holder == "script"
        with WithheldTime() as withheld:
            base.drive(vx_mps=0.5, duration_s=0.6)
        state = robot.state
        assert state.mode == "ready"
        assert 0.1 < state.odom.pose.x_m < 0.33 + 0.5 * withheld.total_s
        base.go_to(x_m=0.0, y_m=0.1, heading_rad=0.3)
        assert math.dist(robot.state.odom.pose, (0.0, 0.1, 0.3)) < 0.15
    wait_for(lambda: robot.state.mode == "disarmed" and robot.state.lease.holder is None)


def test_the_lease_is_kept_while_the_script_does_nothing(robot: tsd_twin.RobotClient) -> None:
    with robot.control("script") as base:
        robot.sleep(2.6)
        assert base.is_held
        base.drive(vx_mps=0.2, duration_s=0.2)


def test_set_points_flow_until_they_expire(robot: tsd_twin.RobotClient) -> None:
    with robot.control("script") as base:
        counted = robot.state.status.command.accepted
        with WithheldTime() as withheld:
            for _ in range(10):
                base.set_velocity(vx_mps=0.3)
                robot.sleep(0.1)
        accepted = robot.state.status.command.accepted - counted
        assert accepted > 20 - withheld.total_s / COMMAND_PERIOD_S, "the library sends at 50 Hz"
        wait_for(lambda: robot.state.mode == "ready")
        assert robot.state.status.stops == 0, "zeros were sent after the set-point had expired"
        base.set_velocity(vx_mps=0.3)
        base.rest()
        assert robot.state.mode == "ready"


def test_a_thread_that_hangs_moves_nothing(robot: tsd_twin.RobotClient) -> None:
    with robot.control("script") as base, WithheldTime() as withheld:
        base.set_velocity(vx_mps=0.4)
        wait_for(lambda: robot.state.mode == "driving")
        time.sleep(1.5)  # The script hangs here.
        assert robot.state.mode == "ready"
        assert robot.state.odom.pose.x_m < 0.2 + 0.4 * withheld.total_s


def test_a_stop_by_another_program_ends_a_drive(node: RunningNode) -> None:
    endpoint = node.endpoint
    with tsd_twin.connect(endpoint) as robot, tsd_twin.connect(endpoint) as other:

        def stop() -> None:
            wait_for(lambda: other.state.mode == "driving")
            other.stop("cat on the track")

        with robot.control("script") as base:
            stopping = threading.Thread(target=stop)
            stopping.start()
            with pytest.raises(RobotStopped, match="cat on the track"):
                base.drive(vx_mps=0.3, duration_s=10.0)
            stopping.join()
        assert robot.state.mode == "stopped"


def test_a_take_over_is_seen_by_who_had_control(node: RunningNode) -> None:
    with tsd_twin.connect(node.endpoint) as robot, tsd_twin.connect(node.endpoint) as other:
        with robot.control("alice") as alice:
            with pytest.raises(ControlDenied, match="alice drives") as denied:
                other.control("bob").acquire()
            assert denied.value.holder == "alice"
            with other.control("bob", take_over=True) as bob:
                wait_for(lambda: not alice.is_held)
                with pytest.raises(ControlLost, match="bob has control now"):
                    alice.set_velocity(vx_mps=0.2)
                bob.drive(vx_mps=0.2, duration_s=0.2)
        wait_for(lambda: other.state.lease.holder is None)


def test_two_programs_under_one_name_do_not_share_the_lease(node: RunningNode) -> None:
    with (
        tsd_twin.connect(node.endpoint) as robot,
        tsd_twin.connect(node.endpoint) as other,
        robot.control("script") as first,
        other.control("script", take_over=True) as second,
    ):
        wait_for(lambda: not first.is_held)
        with pytest.raises(ControlLost, match="another client"):
            first.drive(vx_mps=0.2, duration_s=0.2)
        second.drive(vx_mps=0.2, duration_s=0.2)


def test_control_is_asked_for_and_handed_over(node: RunningNode) -> None:
    with tsd_twin.connect(node.endpoint) as robot, tsd_twin.connect(node.endpoint) as other:
        poses: list[float] = []

        def bob() -> None:
            with other.request_control("bob") as base:
                base.drive(vx_mps=-0.2, duration_s=0.3)
                poses.append(other.state.odom.pose.x_m)

        with robot.control("alice") as base:
            asking = threading.Thread(target=bob)
            asking.start()
            wait_for(lambda: base.requested_by == "bob")
            base.hand_over()
            assert not base.is_held
            asking.join(PATIENCE_S)
        assert poses
        assert poses[0] < -0.02


def test_control_that_is_kept_is_denied_at_once(node: RunningNode) -> None:
    with (
        tsd_twin.connect(node.endpoint) as robot,
        tsd_twin.connect(node.endpoint) as other,
        robot.control("alice") as base,
    ):

        def keep() -> None:
            wait_for(lambda: base.requested_by == "bob")
            base.deny()

        keeping = threading.Thread(target=keep)
        keeping.start()
        watch = Stopwatch()
        with pytest.raises(ControlDenied, match="alice keeps control"):
            other.request_control("bob").acquire()
        assert watch.took_s < 10.0
        keeping.join()
        with pytest.raises(ControlDenied):
            other.request_control("bob", timeout_s=0.3).acquire()
        assert base.is_held
        wait_for(lambda: base.requested_by is None)


def test_a_robot_that_falls_silent_ends_a_drive_and_is_named_when_left() -> None:
    with running() as node:
        robot = tsd_twin.connect(node.endpoint)
        base = robot.control("script")
        base.acquire()
        ending = threading.Timer(0.3, node.stopping.set)
        ending.start()
        # Either a stopping status arrives first, or silence is detected first.
        with pytest.raises((RobotStopped, RobotSilent)):
            base.drive(vx_mps=0.2, duration_s=20.0)
        ending.join()
        with pytest.raises(RobotSilent, match="could not be disarmed, nor stopped"):
            robot.close()
        assert repr(robot) == "<RobotClient tsd: closed>"


def test_states_events_and_callbacks(robot: tsd_twin.RobotClient) -> None:
    seen: list[tsd_twin.RobotState] = []
    told: list[Event] = []
    watching = robot.on_state(seen.append, maxlen=10)
    listening = robot.on_event(told.append)
    with WithheldTime() as withheld:
        states = list(robot.states(1.0))
    assert 30 - 50.0 * withheld.total_s < len(states) < 60
    stamps = [state.odom.stamp_s for state in states]
    assert stamps == sorted(set(stamps))
    with robot.control("script"):
        assert robot.state.joints.names == robot.state.setpoint.names
        assert robot.state.truth is not None
    wait_for(lambda: {event.kind for event in told} >= {"lease", "mode"})
    wait_for(lambda: len(seen) > 30)
    watching.close()
    listening.close()


def test_a_callback_that_fails_or_is_slow_holds_nothing_up(robot: tsd_twin.RobotClient) -> None:
    calls: list[float] = []

    def slow(state: tsd_twin.RobotState) -> None:
        calls.append(state.received_s)
        time.sleep(0.2)
        raise ValueError("a mistake of the script")

    watching = robot.on_state(slow)
    with robot.control("script") as base:
        base.drive(vx_mps=0.2, duration_s=0.5)
    wait_for(lambda: len(calls) >= 2 and watching.dropped > 5)
    watching.close()


def test_no_robot_and_several_are_told_apart(node: RunningNode) -> None:
    with pytest.raises(NoRobotFound, match="tsd-demo"):
        tsd_twin.connect("tcp/127.0.0.1:1")
    worked_s = time.thread_time()
    with pytest.raises(NoRobotFound, match=r"no robot 'left' answers: tcp/\S+ has tsd"):
        tsd_twin.connect(node.endpoint, robot="left")
    assert time.thread_time() - worked_s < 0.5, "it waits rather than asking all the time"
    io = SimRobot(node.robot)
    second = RobotNode(node.bus, "left", node.robot, io, Description(QUICK, ""))
    stop = threading.Event()
    thread = threading.Thread(target=second.run, args=(stop,))
    thread.start()
    try:
        with pytest.raises(SeveralRobotsFound, match=r"left, tsd are at .*robot='left'") as several:
            tsd_twin.connect(node.endpoint)
        assert several.value.robots == ("left", "tsd")
        with tsd_twin.connect(node.endpoint, robot="left") as robot:
            assert robot.id == "left"
    finally:
        stop.set()
        thread.join()


def test_a_bus_without_a_robot_is_no_robot() -> None:
    with Bus(node_config([ANY_PORT])) as bus:
        (endpoint,) = bus.endpoints()
        with pytest.raises(NoRobotFound, match="start one with tsd-demo"):
            tsd_twin.connect(endpoint)


def test_the_asyncio_face_drives_reads_and_leaves(node: RunningNode) -> None:
    async def script() -> float:
        async with tsd_twin.connect_async(node.endpoint) as robot:
            async with robot.control("script") as base:
                await base.drive(vx_mps=0.3, duration_s=0.5)
                await base.go_to(x_m=0.3, y_m=0.0)
                async for state in robot.states(PATIENCE_S):
                    base.set_velocity(vy_mps=0.2)
                    if state.mode == "driving":
                        break
                assert state.mode == "driving"
                await base.rest()
                async for event in robot.events():
                    assert event.kind
                    break
                x_m = robot.state.odom.pose.x_m
            while robot.state.lease.holder is not None:
                await robot.changed(0.1)
        return x_m

    assert asyncio.run(script()) == pytest.approx(0.3, abs=0.06)


def test_a_cancelled_drive_sends_zero_and_control_is_given_back(node: RunningNode) -> None:
    async def script() -> None:
        async with tsd_twin.connect_async(node.endpoint) as robot:

            async def far() -> None:
                async with robot.control("script") as base:
                    await base.drive(vx_mps=0.3, duration_s=60.0)

            driving = asyncio.create_task(far())
            while robot.state.mode != "driving":
                await robot.changed(0.1)
            driving.cancel()
            with pytest.raises(asyncio.CancelledError):
                await driving
            # The lease is released afterwards; a status may arrive in between.
            while robot.state.mode != "disarmed" or robot.state.lease.holder is not None:
                await robot.changed(0.1)

    asyncio.run(asyncio.wait_for(script(), PATIENCE_S))


def test_an_event_loop_that_is_blocked_moves_nothing(quick_node: RunningNode) -> None:
    async def script() -> None:
        async with tsd_twin.connect_async(quick_node.endpoint) as robot:
            base = robot.control("script")
            await base.acquire()
            while robot.state.mode != "driving":
                base.set_velocity(vx_mps=0.4)
                await robot.changed(0.1)
            stops, x_m = robot.state.status.stops, robot.state.odom.pose.x_m
            with WithheldTime() as withheld:
                time.sleep(1.5)
            state = robot.state
            assert state.mode == "ready"
            assert state.status.stops == stops + 1, "nothing was sent: the robot stopped by itself"
            assert state.odom.pose.x_m < x_m + 0.25 + 0.4 * withheld.total_s

    asyncio.run(asyncio.wait_for(script(), PATIENCE_S))


def test_the_synchronous_face_works_in_a_notebook(node: RunningNode) -> None:
    """Notebook cells run in a thread with a running event loop, and without `with`."""

    async def cells() -> None:
        robot = tsd_twin.connect(node.endpoint)
        base = robot.control("notebook")
        base.acquire()
        base.drive(vx_mps=0.2, duration_s=0.3)
        assert repr(base) == "<RobotControl: notebook has control of tsd>"
        base.release()
        assert not base.is_held
        base.acquire()
        robot.close()
        assert not base.is_held

    asyncio.run(cells())


SCRIPT = """
import sys, tsd_twin
robot = tsd_twin.connect(sys.argv[1])
base = robot.control("script")
base.acquire()
print("driving", flush=True)
{rest}
"""


def test_a_script_that_forgets_to_close_ends_and_gives_control_back(node: RunningNode) -> None:
    code = SCRIPT.format(rest="base.set_velocity(vx_mps=0.2)")
    done = subprocess.run(
        [sys.executable, "-c", code, node.endpoint],
        timeout=PATIENCE_S,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    with tsd_twin.connect(node.endpoint) as robot:
        wait_for(lambda: robot.state.lease.holder is None and robot.state.mode == "disarmed")


def test_an_interrupt_gives_control_back_and_is_raised(node: RunningNode) -> None:
    code = SCRIPT.format(rest="with robot:\n    base.drive(vx_mps=0.3, duration_s=60.0)")
    script = subprocess.Popen(
        [sys.executable, "-c", code, node.endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with tsd_twin.connect(node.endpoint) as robot:
        wait_for(lambda: robot.state.mode == "driving")
        script.send_signal(signal.SIGINT)
        _, said = script.communicate(timeout=PATIENCE_S)
        assert said.rstrip().endswith("KeyboardInterrupt")
        assert robot.state.lease.holder is None
        wait_for(lambda: robot.state.mode == "disarmed")


def test_the_client_is_quick_to_import() -> None:
    """`import tsd_twin` does not load the bus, so programs without a client start fast."""
    code = "import sys, json, tsd_twin; print(json.dumps([m for m in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(json.loads(done.stdout))
    assert "tsd_twin" in loaded
    assert not loaded & {"zenoh", "numpy", "tsd_twin.client"}
