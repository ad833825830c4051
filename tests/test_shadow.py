"""The shadow twin: its inputs, its reports, and its restarts."""

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
from tsd_twin.estimation.joint_errors import jacobians
from tsd_twin.lie import SE2
from tsd_twin.messages.cdr import JointState
from tsd_twin.messages.codes import Code, because
from tsd_twin.shadow import STREAMS, ShadowFeed, ShadowTwin
from tsd_twin.shadow.fault_filter import FaultFilter, Hypothesis, with_pairs


def states(robot: RobotClient, seconds: float, *, vx_mps: float = 0.4) -> Iterator[RobotState]:
    """Yield the states of a robot that repeatedly starts, drives and stops."""
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
    assert report.note == because(Code.SPEEDS_UNMEASURED)


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


SIGMA = np.array([3e-3, 3e-3, 8e-3])
WHEELS, ZEROS = range(3), range(3, 9)


def blocks(seed: int, count: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield fault columns (3, 12), noise (3,) and another error (3,) for each half second.

    The robot changes direction every 2.5 s, with a constant gimbal error in each. The last three
    columns are disturbances that do not belong to parts.
    """
    robot = robots.load_robot("tsd")
    kinematics, random = robot.kinematics(), np.random.default_rng(seed)
    columns, aside = np.zeros((3, 12)), np.zeros(3)
    for i in range(count):
        if i % 5 == 0:
            angle = random.uniform(0.0, 2.0 * np.pi)
            twist = np.array([math.cos(angle), math.sin(angle), random.uniform(-0.6, 0.6)])
            joints = kinematics.inverse(twist)
            slopes = 0.5 * jacobians(kinematics, joints)[0]
            is_angle = np.tile([True, True, False], 3)
            columns = np.hstack([-slopes[:, ~is_angle] * joints[~is_angle], slopes[:, is_angle]])
            columns = np.hstack([columns, 0.5 * np.eye(3)])
            aside = 2e-3 * random.standard_normal(3)
        yield columns, SIGMA * random.standard_normal(3), aside


def fed(faults: np.ndarray, seed: int, count: int, test: FaultFilter | None = None) -> FaultFilter:
    """Update a fault filter with some blocks of a robot with `faults` (12,)."""
    if test is None:
        wheels = [Hypothesis((i,), positive=True) for i in WHEELS]
        zeros = [Hypothesis((i,)) for i in ZEROS]
        sigma = np.concatenate([np.full(3, 0.01), np.full(3, 2e-3)])
        scale = np.concatenate([np.full(3, 0.08), np.full(6, 0.02), np.full(3, 0.1)])
        test = FaultFilter(sigma, scale, 0.25 * scale, with_pairs(wheels) + with_pairs(zeros))
    for i, (columns, noise, aside) in enumerate(blocks(seed, count)):
        test.predict(np.concatenate([np.ones(3), np.full(3, float(i % 5 > 0))]), np.zeros(6))
        rows = np.hstack([columns[:, :3], np.eye(3)])
        test.add(columns @ faults + aside + noise, rows, columns, np.diag(SIGMA**2))
    return test


def sound(seed: int) -> np.ndarray:
    faults = np.zeros(12)
    faults[:3] = 0.01 * np.random.default_rng([seed, 1]).standard_normal(3)
    return faults


def named(test: FaultFilter) -> tuple[int, ...] | None:
    return None if test.verdict is None else test.verdict.explanation


@pytest.mark.parametrize("faulty", [(0,), (2,), (3,), (8,), (0, 1)])
def test_parts_are_named_in_time_and_withdrawn_when_they_are_repaired(
    faulty: tuple[int, ...],
) -> None:
    for seed in range(3):
        before = sound(seed)
        broken = before.copy()
        broken[list(faulty)] += [0.06 if i in WHEELS else 0.02 for i in faulty]
        test = fed(before, seed, 40)
        assert named(test) is None
        fed(broken, seed + 10, 30, test)
        assert named(test) == faulty
        assert test.verdict is not None
        assert test.verdict.sizes == pytest.approx(
            broken[list(faulty)] - before[list(faulty)], abs=0.02
        )
        fed(before, seed + 20, 240, test)
        assert named(test) is None


def test_a_part_that_was_bad_from_the_start_is_named_as_such() -> None:
    faults = np.zeros(12)
    faults[1] = 0.07
    test = fed(faults, 5, 40)
    assert named(test) == (1,)
    assert test.verdict is not None
    assert test.verdict.begun == 0


@pytest.mark.parametrize("disturbance", range(9, 12))
def test_what_no_part_explains_has_no_name(disturbance: int) -> None:
    test = fed(sound(7), 7, 40)
    faults = sound(7)
    faults[disturbance] += 0.15
    for _ in range(20):
        fed(faults, 8, 2, test)
        assert not named(test)
    assert named(test) == ()


def test_two_parts_that_explain_it_alike_are_both_said() -> None:
    """Two equal columns are ambiguous."""
    hypotheses = [Hypothesis((0,)), Hypothesis((1,))]
    test = FaultFilter(np.full(1, 1e-3), np.full(2, 0.1), np.full(2, 0.02), hypotheses)
    random = np.random.default_rng(9)
    for i in range(40):
        error = 0.1 * (i > 20) + 0.02 * random.standard_normal(1)
        test.predict(np.ones(1), np.zeros(1))
        test.add(error, np.ones((1, 1)), np.ones((1, 2)), np.full((1, 1), 4e-4))
    assert test.verdict is not None
    assert test.verdict.explanation == ()
    assert [each.columns for each in test.verdict.alike] == [(0,), (1,)]


def test_one_wild_block_proves_nothing() -> None:
    test = fed(sound(11), 11, 40)
    for columns, noise, aside in blocks(12, 1):
        test.predict(np.ones(6), np.zeros(6))
        rows = np.hstack([columns[:, :3], np.eye(3)])
        test.add(1.0 + aside + noise, rows, columns, np.diag(SIGMA**2))
    fed(sound(11), 13, 10, test)
    assert named(test) is None


def test_no_part_is_named_in_an_hour_of_errors_as_described() -> None:
    for seed in range(2):
        test = fed(sound(seed), seed, 1)
        for minute in range(30):
            fed(sound(seed), 100 * seed + minute, 120, test)
            assert named(test) is None
