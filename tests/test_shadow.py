"""The shadow twin: what it takes, what it reports, and when it begins anew."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.client.state import RobotState
from tsd_twin.client.sync import RobotClient
from tsd_twin.client.virtual import SimulatedRobot
from tsd_twin.lie import SE2
from tsd_twin.messages.cdr import JointState
from tsd_twin.shadow import STREAMS, ShadowFeed, ShadowTwin
from tsd_twin.shadow.fault_detectors import SLOW_WHEEL, WheelTest


def states(robot: RobotClient, seconds: float, *, vx_mps: float = 0.4) -> Iterator[RobotState]:
    """Yield the states of a robot that starts, drives and stops again and again."""
    with robot.control() as control:
        begin_s = robot.time_s
        driving = control.driving(
            lambda now_s: (vx_mps * ((now_s - begin_s) % 2.0 < 1.0), 0.1, 0.2)
        )
        for now_s in itertools.takewhile(lambda now_s: now_s < begin_s + seconds, driving):
            assert now_s >= begin_s
            yield robot.state


def feed(twin: ShadowTwin, state: RobotState) -> None:
    stamp_ns = state.joints.stamp_ns
    twin.advance(stamp_ns, state.joints, state.setpoint, state.odom.message, state.status)


@pytest.mark.parametrize("name", robots.robot_names())
def test_a_sound_robot_is_inside_its_bands_and_nothing_drifts(name: str) -> None:
    twin = ShadowTwin(robots.load_robot(name))
    joints = [joint.name for joint in robots.load_robot(name).kinematics().joints]
    outside = total = 0
    report = twin.report()
    with SimulatedRobot(name, seed=900, noise=1.0) as robot:
        for state in states(robot, 5.0, vx_mps=0.2):
            feed(twin, state)
            report = twin.report()
            if report.compared_s > 1.0:
                assert [joint.name for joint in report.joints] == joints
                outside += sum(not joint.inside for joint in report.joints)
                total += len(joints)
                assert report.pose is None or all(map(math.isfinite, report.pose.difference))
    assert total > 100 * len(joints)
    assert outside <= 0.005 * total
    assert report.pose is not None
    assert report.pose.inside
    assert not report.drifts
    assert msgspec.json.decode(msgspec.json.encode(report), type=type(report)) == report


def test_unmeasured_wheels_are_said_to_be_so() -> None:
    twin = ShadowTwin(robots.load_robot("tsd"))
    with SimulatedRobot("tsd") as robot:
        for state in states(robot, 2.5):
            feed(twin, state)
    report = twin.report()
    assert [joint.measured is None for joint in report.joints] == 3 * [False, False, True]
    assert "not measured" in report.note


def test_states_that_come_twice_late_or_are_no_numbers_change_nothing() -> None:
    robot = robots.load_robot("kiwi")
    clean, disturbed = ShadowTwin(robot), ShadowTwin(robot)
    with SimulatedRobot("kiwi", seed=901, noise=1.0) as client:
        seen = list(states(client, 3.0))
    before = None
    for state in seen:
        feed(clean, state)
        feed(disturbed, state)
        if before is not None:
            feed(disturbed, before)
        feed(disturbed, state)
        nan = JointState(
            state.joints.names,
            np.full(3, math.nan),
            np.full(3, math.nan),
            state.joints.stamp_ns + 5_000_000,
        )
        disturbed.advance(nan.stamp_ns, state.joints, nan, None, None)
        other = JointState(["other"], np.zeros(1), np.zeros(1))
        disturbed.advance(nan.stamp_ns, other, state.setpoint, None, None)
        before = state
    assert disturbed.report() == clean.report()


def test_after_a_gap_it_begins_anew_where_the_robot_is() -> None:
    twin = ShadowTwin(robots.load_robot("tsd"))
    with SimulatedRobot("tsd", seed=902, noise=1.0) as robot:
        seen = list(states(robot, 6.0))
    for state in [*seen[:120], *seen[150:]]:
        feed(twin, state)
    report = twin.report()
    assert report.compared_s == pytest.approx(0.02 * (len(seen) - 151), abs=0.1)
    assert all(joint.inside for joint in report.joints)
    assert not report.drifts


def test_a_pose_that_is_set_is_no_motion() -> None:
    twin = ShadowTwin(robots.load_robot("kiwi"))
    report = twin.report()
    with SimulatedRobot("kiwi", seed=903, noise=1.0) as robot:
        for i, state in enumerate(states(robot, 5.0)):
            odom = state.odom.message
            if i > 130:
                moved = (SE2(np.array([3.0, -2.0, 0.5])) @ SE2(odom.xy_heading)).xy_heading
                odom = type(odom)(
                    moved, odom.twist, odom.pose_covariance, odom.twist_covariance, odom.stamp_ns
                )
            twin.advance(odom.stamp_ns, state.joints, state.setpoint, odom, state.status)
            report = twin.report()
            assert report.pose is None or report.pose.inside
    assert report.pose is not None


def test_messages_that_come_one_by_one_in_any_order_are_put_together() -> None:
    robot = robots.load_robot("kiwi")
    direct, fed = ShadowTwin(robot), ShadowFeed(ShadowTwin(robot))
    random = np.random.default_rng(904)
    with SimulatedRobot("kiwi", seed=904, noise=1.0) as client:
        for i, state in enumerate(states(client, 3.0)):
            parts = {"joints": state.joints, "setpoint": state.setpoint, "odom": state.odom.message}
            assert parts.keys() == STREAMS.keys()
            fed.status = state.status
            if i % 10 == 9:  # One is lost.
                del parts[str(random.choice(list(parts)))]
            else:
                feed(direct, state)
            for name in random.permutation(list(parts)):
                fed.add(str(name), parts[str(name)], state.joints.stamp_ns)
    assert fed.twin.report() == direct.report()


def wheel_test_after(losses: np.ndarray, seed: int, test: WheelTest | None = None) -> WheelTest:
    """Let a wheel test see half a second of motion for each row of `losses` (n, 3).

    The robot has a new direction each 2.5 s; its gimbals have a constant error in each.
    """
    robot = robots.load_robot("tsd")
    kinematics, random = robot.kinematics(), np.random.default_rng(seed)
    test = test or WheelTest(robot, ["module1_wheel", "module2_wheel", "module3_wheel"], np.ones(3))
    sigma = np.array([3e-3, 3e-3, 8e-3])
    per_loss, aside = np.zeros((3, 3)), np.zeros(3)
    for i, loss in enumerate(losses):
        is_new = i % 5 == 0
        if is_new:
            angle = random.uniform(0.0, 2.0 * np.pi)
            twist = np.array([math.cos(angle), math.sin(angle), random.uniform(-0.6, 0.6)])
            joints = kinematics.inverse(twist)
            slower = np.where(np.eye(9)[2::3] > 0.0, 0.999, 1.0) * joints
            per_loss = 0.5 * (kinematics.forward(slower).twist - twist).T / 0.001
            aside = 2e-3 * random.standard_normal(3)
        test.keep(np.full(3, 0.0 if is_new else 1.0), 0.5)
        error = per_loss @ loss + aside + sigma * random.standard_normal(3)
        test.add(error, np.hstack([per_loss, 2e-3 * np.eye(3)]), np.diag(sigma**2))
    return test


def test_a_slow_wheel_is_named_in_time_and_its_name_withdrawn_when_it_is_repaired() -> None:
    for seed in range(6):
        sound = 0.01 * np.random.default_rng([seed, 1]).standard_normal(3)
        slow = sound + SLOW_WHEEL * np.eye(3)[seed % 3]
        test = wheel_test_after(np.tile(sound, (40, 1)), seed)
        assert test.drifts() == []
        wheel_test_after(np.tile(slow, (20, 1)), seed + 10, test)
        assert [drift.part for drift in test.drifts()] == [f"module{seed % 3 + 1}_wheel"]
        wheel_test_after(np.tile(sound, (40, 1)), seed + 20, test)
        assert test.drifts() == []


def test_no_wheel_is_named_in_an_hour_of_errors_as_described() -> None:
    for seed in range(2):
        sound = 0.01 * np.random.default_rng([seed, 2]).standard_normal(3)
        test = WheelTest(robots.load_robot("tsd"), ["a_wheel", "b_wheel", "c_wheel"], np.ones(3))
        for minute in range(30):
            wheel_test_after(np.tile(sound, (120, 1)), 100 * seed + minute, test)
            assert test.drifts() == []
