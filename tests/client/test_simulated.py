"""The client with a robot in virtual time and the real controller."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

import tsd_twin
from tsd_twin import (
    ClientError,
    ControlDenied,
    ControlLost,
    RequestRefused,
    RobotState,
    RobotStopped,
    SimulatedRobot,
)
from tsd_twin.errors import PathError
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.events import Event


def test_a_drive_goes_as_far_as_it_says_and_ends_at_rest() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        base.drive(vx_mps=0.5, duration_s=1.0)
        state = robot.state
        assert state.mode == "ready"
        assert state.odom.pose.x_m == pytest.approx(0.5, abs=0.03)
        before = state.odom.pose
        robot.sleep(5.0)
        assert math.dist(before[:2], robot.state.odom.pose[:2]) < 0.005


@pytest.mark.parametrize("name", ["tsd", "kiwi", "mecanum", "omni4"])
def test_every_robot_on_a_floor_goes_where_it_is_sent(name: str) -> None:
    with SimulatedRobot(name, seed=1, noise=1.0) as robot, robot.control("script") as base:
        base.go_to(x_m=0.4, y_m=-0.3, heading_rad=1.0)
        x_m, y_m, heading_rad = robot.state.odom.pose
        assert math.dist((x_m, y_m), (0.4, -0.3)) < 0.05
        assert heading_rad == pytest.approx(1.0, abs=0.1)
        assert robot.state.mode == "ready"


def _publish_pose(robot: SimulatedRobot, random: np.random.Generator, state: RobotState) -> None:
    x_m, y_m, heading_rad = state.truth.pose + 0.005 * random.standard_normal(3)
    robot.publish_pose(x_m, y_m, heading_rad)


def _misses_m(*, camera: bool) -> list[float]:
    """Return the true distances from the goals for robots with errors."""
    misses_m: list[float] = []
    for seed in range(2):
        robot = SimulatedRobot("tsd", seed=seed, noise=1.0, errors=1.0)
        with robot, robot.control("script") as base:
            if camera:
                robot.on_state(partial(_publish_pose, robot, np.random.default_rng(seed)))
            for goal in [(1.5, 0.0), (0.5, 1.0)]:
                base.go_to(x_m=goal[0], y_m=goal[1])
                pose = robot.state.odom.pose
                assert math.dist((pose.x_m, pose.y_m), goal) < 0.05
                misses_m.append(math.dist(robot.state.truth.pose[:2], goal))
    return misses_m


def test_go_to_arrives_in_truth_with_a_pose_sensor() -> None:
    watched_m, blind_m = _misses_m(camera=True), _misses_m(camera=False)
    assert max(watched_m) < 0.05
    assert np.median(watched_m) < 0.3 * np.median(blind_m)


def test_a_loop_that_drives_ends_at_rest_however_it_is_left() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script", arm=False) as base:
        assert max(base.arming()) == pytest.approx(1.0)
        start_s = robot.time_s

        def twist_at(now_s: float) -> tuple[float, float, float] | None:
            return (0.3, 0.0, 0.0) if now_s - start_s < 1.0 else None

        times_s = list(base.driving(twist_at))
        assert np.diff(times_s) == pytest.approx(0.02)
        assert robot.state.mode == "ready"
        assert robot.state.odom.pose.x_m == pytest.approx(0.3, abs=0.05)
        for now_s in base.driving(lambda _: (0.3, 0.0, 0.0)):
            assert now_s == robot.time_s
            if robot.state.odom.pose.x_m > 0.5:
                break
        robot.sleep(0.5)
        assert robot.state.mode == "ready"
        assert robot.state.status.stops == 0, "a zero has ended it, not the missing commands"

        def fail(_: float) -> tuple[float, float, float]:
            raise ValueError("a mistake")

        with pytest.raises(ValueError, match="a mistake"):
            list(base.driving(fail))
        assert sum(base.staying_ready(1.0)) > 0.0
        base.drive(vx_mps=0.2, duration_s=0.2)


def test_a_path_is_followed_near_its_points() -> None:
    line = [(0.3, 0.0), (0.6, 0.2), (0.6, 0.5), (0.3, 0.6)]
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        passed: list[tuple[float, float, float]] = []
        robot.on_state(lambda state: passed.append(state.odom.pose))
        base.follow_path(line, heading_rad=-0.5)
    track = np.array(passed)[:, :2]
    for point in line:
        assert np.hypot(*(track - point).T).min() < 0.05
    assert math.dist(passed[-1][:2], line[-1]) < 0.02


def test_a_sphere_turns_and_goes_nowhere() -> None:
    with SimulatedRobot("atlas") as robot, robot.control("script") as base:
        base.turn(wx_rad_per_s=0.5, duration_s=1.0)
        w, x, y, z = robot.state.odom.orientation
        assert 2.0 * math.asin(x) == pytest.approx(0.5, abs=0.05)
        assert (y, z) == pytest.approx((0.0, 0.0), abs=0.02)
        assert w > 0.9
        with pytest.raises(ClientError, match="sphere"):
            base.drive(vx_mps=0.1, duration_s=1.0)
        with pytest.raises(ClientError, match="goes nowhere"):
            base.go_to(x_m=1.0, y_m=0.0)
        with pytest.raises(tsd_twin.TwinError, match="orientation"):
            _ = robot.state.odom.pose
        base.set_orientation(x=1.0, w=0.0)
        assert abs(robot.state.odom.orientation.x) == pytest.approx(1.0)


def test_a_set_point_that_is_not_refreshed_ends_by_itself() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        base.set_velocity(vx_mps=0.3)
        robot.sleep(0.15)
        assert robot.state.mode == "driving"
        robot.sleep(1.0)
        state = robot.state
        assert state.mode == "ready"
        assert state.status.stops == 0, "zeros were commanded: the robot had not to stop by itself"
        assert state.odom.pose.x_m < 0.3 * 0.2 + 0.3**2 / 2.0 + 0.03
        base.set_velocity(vx_mps=-0.3)
        robot.sleep(0.1)
        assert robot.state.mode == "driving"


def test_a_set_point_that_fails_is_told_by_the_next_motion() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        base.set_velocity(vx_mps=0.3)
        robot.sleep(0.1)
        robot.stop("cat on the track")
        robot.sleep(1.0)
        base.reset()
        base.arm()
        with pytest.raises(RobotStopped) as stopped:
            base.drive(vx_mps=0.3, duration_s=0.5)
        assert stopped.value.params["text"] == "cat on the track"
        base.drive(vx_mps=0.3, duration_s=0.5)


def test_two_runs_with_one_seed_are_one_run() -> None:
    def run(seed: int) -> tuple[float, float, float]:
        with SimulatedRobot("tsd", seed=seed, noise=1.0, errors=1.0) as robot:
            with robot.control("script") as base:
                base.drive(vx_mps=0.3, omega_rad_per_s=0.5, duration_s=2.0)
            return robot.state.odom.pose

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_any_exit_brings_the_robot_to_rest_disarms_and_releases() -> None:
    with SimulatedRobot("tsd") as robot:
        base = robot.control("script")

        def fail() -> None:
            with base:
                base.set_velocity(vx_mps=0.4)
                robot.sleep(0.1)
                assert robot.state.mode == "driving"
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            fail()
        robot.sleep(2.0)
        state = robot.state
        assert (state.mode, state.lease.holder) == ("disarmed", None)
        assert not base.is_held
        with pytest.raises(ControlLost):
            base.drive(vx_mps=0.1, duration_s=0.1)


def test_the_state_says_what_the_robot_would_refuse() -> None:
    with SimulatedRobot("tsd") as robot:
        free = robot.state.status.refusals
        assert free is not None
        assert free.arm == free.no_lease
        assert free.why["arm"].code == Code.TAKE_CONTROL_FIRST
        with robot.control("alice") as base:
            held = robot.state.status.refusals
            assert held is not None
            assert (held.drive, held.disarm) == (None, None)
            assert held.why["no_lease"] == because(Code.HELD_BY, holder="alice")
            with pytest.raises(RequestRefused) as refused:
                base.reset()
            assert refused.value.why == held.why["reset"]


def test_refusals_have_the_reason_of_the_robot() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("alice") as base:
        with pytest.raises(ControlDenied) as denied:
            robot.control("bob").acquire()
        assert denied.value.why == because(Code.DRIVEN_BY, holder="alice")
        assert denied.value.holder == "alice"
        with pytest.raises(RequestRefused) as refused:
            base.reset()
        assert refused.value.code == Code.NOT_LATCHED
        with pytest.raises(RequestRefused) as refused:
            base.set_wheel_speed(50.0)
        assert refused.value.code == Code.WHEEL_SPEED_REFUSED
        with pytest.raises(RequestRefused, match="hand over control: ") as refused:
            base.hand_over("bob")
        assert refused.value.code == Code.NO_REQUEST
        with pytest.raises(PathError):
            base.go_to(x_m=1000.0, y_m=0.0)
        with pytest.raises(ClientError, match="duration"):
            base.drive(vx_mps=0.1, duration_s=math.nan)
        with pytest.raises(ClientError, match="frame"):
            base.drive(vx_mps=0.1, duration_s=0.1, frame="map")
        assert robot.state.mode == "ready"


def test_a_stop_ends_a_motion_and_wants_a_reset() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        fired: list[bool] = []

        def stop_once(state: tsd_twin.RobotState) -> None:
            if state.mode == "driving" and not fired:
                fired.append(True)
                robot.stop("cat on the track")

        watching = robot.on_state(stop_once)
        with pytest.raises(RobotStopped, match="cat on the track"):
            base.drive(vx_mps=0.4, duration_s=5.0)
        watching.close()
        with pytest.raises(RobotStopped, match="stopped"):
            base.drive(vx_mps=0.4, duration_s=1.0)
        with pytest.raises(RobotStopped, match="reset it first"):
            base.arm()
        robot.sleep(1.0)
        base.reset()
        base.arm()
        base.drive(vx_mps=0.4, duration_s=0.5)
        assert robot.state.mode == "ready"


def test_a_take_over_ends_the_control_of_the_other() -> None:
    with SimulatedRobot("tsd") as robot:
        alice = robot.control("alice")
        alice.acquire()
        alice.set_velocity(vx_mps=0.3)
        robot.sleep(0.1)
        with robot.control("bob", take_over=True, reason="my turn") as bob:
            robot.sleep(0.5)
            with pytest.raises(ControlLost, match="bob has control now"):
                alice.set_velocity(vx_mps=0.3)
            assert not alice.is_held
            bob.drive(vx_mps=0.2, duration_s=0.5)
            alice.release()
            robot.sleep(0.5)
            assert robot.state.lease.holder == "bob"
            assert robot.state.mode == "ready", "who has lost control disarms no robot"


def test_pose_and_wheel_speed_can_be_set() -> None:
    with SimulatedRobot("tsd") as robot, robot.control("script") as base:
        base.set_pose(x_m=2.0, y_m=-1.0, heading_rad=0.5)
        assert robot.state.odom.pose == pytest.approx((2.0, -1.0, 0.5))
        base.set_wheel_speed(3000.0)
        robot.sleep(5.0)
        wheels = robot.state.status.wheel_speed
        assert wheels is not None
        assert wheels.requested_rpm == pytest.approx(3000.0)
        base.go_to(x_m=2.3, y_m=-1.0)
        assert robot.state.odom.pose.x_m == pytest.approx(2.3, abs=0.03)


def test_a_pose_sensor_keeps_the_estimate_near_the_truth() -> None:
    def error_m(has_sensor: bool) -> float:
        with SimulatedRobot("tsd", seed=0, noise=1.0, errors=1.0) as robot:
            with robot.control("script") as base:
                for _ in range(100):
                    base.set_velocity(vx_mps=0.4, omega_rad_per_s=0.5)
                    robot.sleep(0.1)
                    if has_sensor and robot.state.truth is not None:
                        robot.publish_pose(*robot.state.truth.pose)
            assert robot.state.truth is not None
            return math.dist(robot.state.truth.pose[:2], robot.state.odom.pose[:2])

    assert error_m(has_sensor=True) < 0.2 * error_m(has_sensor=False)


def test_states_and_events_flow_in_virtual_time() -> None:
    with SimulatedRobot("tsd") as robot:
        events = robot.events()
        seen: list[Event] = []
        robot.on_event(seen.append)
        with robot.control("script", arm=False) as base:
            base.arm()
            states = list(robot.states(1.0))
            assert len(states) == 50
            assert {state.mode for state in states} == {"ready"}
            assert states[0].joints.names == states[0].setpoint.names
        kinds = {event.kind for event in events.take()}
        assert kinds == {event.kind for event in seen} == {"lease", "mode"}


def test_a_slow_reader_misses_the_oldest_and_is_told_how_many() -> None:
    subscription = tsd_twin.client.Subscription[int](3)
    for number in range(10):
        subscription.put(number)
    assert subscription.take() == [7, 8, 9]
    assert subscription.dropped == 7
    subscription.close()
    subscription.put(11)
    assert list(subscription) == []


def test_what_is_shown_says_what_it_is() -> None:
    robot = SimulatedRobot("tsd")
    control = robot.control("script")
    assert repr(robot).startswith("<SimulatedRobot tsd: RobotState(disarmed, OdometryState(")
    assert repr(control) == "<RobotControl: script has no control of tsd>"
    robot.close()
    assert repr(robot) == "<SimulatedRobot tsd: closed>"
