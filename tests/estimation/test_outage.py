"""Gaps in joint measurements: estimated travel and its covariance."""

from __future__ import annotations

import copy
import functools

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.estimation import MeasurementOutage, exponential_error
from tsd_twin.estimation.outage import HARDWARE_TIMEOUT_S, OUTAGE_S
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.topics import Sample
from tsd_twin.robots import RobotDescription
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.simulation import BoardModel, SimRobot

DT_S = 0.01
HUNG_S = (0.15, 0.4, 1.0, 5.0)
FULL = np.array([1.0, 1.0, 3.0])
MIDDLES = (np.arange(20_000) + 0.5) / 20_000
LIMIT = 16.3  # 99.9 % quantile of chi-square with three degrees of freedom.


@functools.cache
def robot_named(name: str) -> RobotDescription:
    plain = robots.load_robot(name.removesuffix(" with gyro"))
    return plain if plain.name == name else msgspec.structs.replace(plain, gyro=Gyro())


@given(
    stopping_s=st.floats(0.03, 3.0),
    steps_s=st.lists(st.floats(0.001, 2.0), min_size=1, max_size=30),
)
def test_its_moments_are_those_of_a_motion_that_ends_at_any_time(
    stopping_s: float, steps_s: list[float]
) -> None:
    """For any division of an outage into steps."""
    outage, twist = MeasurementOutage(FULL, stopping_s), np.array([0.4, -0.2, 1.0])
    outage.begin(twist)
    way, covariance = np.zeros(3), np.zeros((3, 3))
    for dt_s in steps_s:
        step = outage.advance(dt_s)
        assert 0.0 <= step.share <= 1.0 + 1e-12
        assert np.linalg.eigvalsh(step.white_per_s)[0] > -1e-12
        way += step.twist * dt_s
        covariance += step.white_per_s * dt_s
    ends_s = OUTAGE_S + (HARDWARE_TIMEOUT_S + stopping_s - OUTAGE_S) * MIDDLES
    goes_s = np.minimum(ends_s, sum(steps_s))
    np.testing.assert_allclose(way, twist * goes_s.mean(), rtol=1e-3, atol=1e-6)
    # The covariance also includes sliding, in any direction.
    slid = covariance - goes_s.var() * np.outer(twist, twist)
    speed2 = np.square(twist / FULL).sum()
    np.testing.assert_allclose(
        slid, 0.3**2 * speed2 * goes_s.var() * np.diag(FULL**2), rtol=1e-3, atol=1e-5
    )
    going = np.var(ends_s > sum(steps_s))
    assert step.twist_covariance[0, 1] == pytest.approx(going * twist[0] * twist[1], abs=1e-3)


class Driven:
    """A simulated robot behind a board, and the estimator of its node."""

    def __init__(self, name: str, seed: int = 0) -> None:
        self.robot = robot_named(name)
        self.simulated = SimRobot(self.robot, seed=seed, noise=1.0)
        self.board = BoardModel(self.robot, self.simulated)
        self.estimator = StateEstimator(self.robot)
        self.kinematics = self.robot.kinematics()
        self.now_s = 0.0
        self.rest(self.robot.arming_hold_s)

    def step(self, dt_s: float = DT_S, *, measures: bool = True) -> None:
        """Advance by `dt_s`; the node resumes at the end."""
        self.now_s += dt_s
        measured = self.board.read(self.now_s)
        self.estimator.advance(self.now_s, measured if measures else None, self.setpoint, dt_s)
        self.board.write(self.setpoint, self.now_s)

    def drive(self, twist: Array) -> None:
        """Spin up, accelerate to a twist within 1 s, and hold it for another second."""
        for share in np.clip(np.arange(300) * DT_S - 1.0, 0.0, 1.0):
            self.setpoint = self.kinematics.inverse(share * twist)
            self.step()

    def rest(self, seconds: float = 1.0) -> None:
        """Command rest, as before arming and in a fault, so that the board resumes."""
        upright = self.kinematics.inverse(np.zeros(3))
        self.setpoint: Array = np.where(self.estimator.is_angle, upright, 0.0)
        for _ in range(round(seconds / DT_S) + 1):
            self.step()

    @property
    def true(self) -> SE2:
        pose = self.board.truth(self.now_s).pose
        assert isinstance(pose, SE2)
        return pose

    @property
    def nees(self) -> float:
        """Normalized squared pose error."""
        error = exponential_error(self.estimator.pose, self.true)
        covariance = self.estimator.odometry(0).pose_covariance
        return float(error @ np.linalg.solve(covariance, error))

    @property
    def off_m(self) -> float:
        return float(np.hypot(*(self.estimator.pose.xy_heading - self.true.xy_heading)[:2]))


def full_speed(robot: RobotDescription, random: np.random.Generator) -> Array:
    """A twist at full speed in a random direction, with a turn."""
    angle = random.uniform(-np.pi, np.pi)
    x, y = robot.limits.speed_mps * np.array([np.cos(angle), np.sin(angle)])
    twist = np.array([x, y, random.uniform(-1.0, 1.0)])
    utilization = float(robot.kinematics().joint_utilization(twist))
    return np.asarray(twist / max(1.0, utilization))


@functools.cache
def _at_full_speed(name: str, seed: int) -> Driven:
    driven = Driven(name, seed)
    driven.drive(full_speed(driven.robot, np.random.default_rng(seed)))
    return driven


def at_full_speed(name: str, seed: int) -> Driven:
    """Return a robot that drives at full speed, in a direction by its seed."""
    driven = _at_full_speed(name, seed)
    return copy.deepcopy(driven, {id(driven.robot): driven.robot})


NAMES = ["tsd", "tsd with gyro", "omni4", "kiwi", "kiwi with gyro", "mecanum"]


@pytest.mark.parametrize("hung_s", HUNG_S)
@pytest.mark.parametrize("name", NAMES)
def test_a_robot_whose_node_hangs_is_within_what_is_claimed(name: str, hung_s: float) -> None:
    """At full speed; the board stops the robot, and the node learns of it when it resumes."""
    for seed in range(100, 104):
        driven = at_full_speed(name, seed)
        assert driven.nees < LIMIT
        driven.step(hung_s)
        assert driven.nees < LIMIT
        if driven.board.tripped:
            driven.rest()
            assert driven.nees < LIMIT
            assert np.abs(driven.estimator.end_twist).max() < 0.02
        assert driven.off_m < 0.6 * driven.robot.limits.speed_mps


@pytest.mark.parametrize("name", NAMES)
def test_errors_are_as_large_as_claimed_when_a_robot_stops_at_any_time(name: str) -> None:
    """Without measurements, the hardware keeps the robot moving for up to its timeout."""
    found = []
    for seed in range(100, 120):
        driven, random = at_full_speed(name, seed), np.random.default_rng([seed, 1])
        ends_s = random.uniform(OUTAGE_S, HARDWARE_TIMEOUT_S)
        for i in range(150):
            if i == round(ends_s / DT_S):
                driven.setpoint = driven.kinematics.inverse(np.zeros(3))
            driven.step(measures=False)
        for _ in range(20):
            driven.step()
        found.append(driven.nees)
    assert 0.5 < np.mean(found) < 6.0
    assert max(found) < 30.0


@pytest.mark.parametrize("name", ["tsd", "kiwi"])
def test_a_pose_sensor_corrects_what_an_outage_made_uncertain(name: str) -> None:
    """Within 1 s, and the estimate had been consistent."""
    driven = Driven(name)
    driven.drive(np.array([0.6, 0.0, 0.0]))
    driven.step(3.0)
    driven.rest()
    assert driven.off_m > 0.02
    sensor = driven.estimator.pose_sensor
    for _ in range(20):
        wall_ns = round(1e9 * driven.now_s)
        seen = encode_pose(PoseStamped.planar(driven.true, wall_ns))
        sensor.receive([Sample(f"twin/{name}/sensor/pose", seen, b"")], driven.now_s, wall_ns)
        for _ in range(5):
            driven.step()
            assert sensor.step(driven.now_s, at_rest=True) is None, "it was wrong"
    status = sensor.status(driven.now_s)
    assert status is not None
    assert status.used > 5
    assert driven.off_m < 0.01


def test_one_measurement_that_is_lost_is_no_outage() -> None:
    """One in twenty, at random: the covariance is the same as without losses."""
    whole, random = Driven("tsd"), np.random.default_rng(0)
    holes = Driven("tsd")
    for driven in (whole, holes):
        driven.drive(np.array([0.5, 0.2, 0.3]))
    for _ in range(400):
        whole.step()
        holes.step(measures=random.random() > 0.05)
    assert whole.nees < LIMIT
    assert holes.nees < LIMIT
    one, other = (each.estimator.odometry(0).pose_covariance for each in (whole, holes))
    np.testing.assert_allclose(np.diag(one), np.diag(other), rtol=0.2)


@settings(max_examples=20)
@given(seed=st.integers(0, 999), hung_s=st.floats(0.11, 20.0))
def test_the_orientation_of_a_sphere_is_within_what_is_claimed(seed: int, hung_s: float) -> None:
    robot = robots.load_robot("atlas")
    board, estimator = BoardModel(robot, SimRobot(robot, seed=seed)), StateEstimator(robot)
    kinematics, now_s = robot.kinematics(), 0.0
    setpoint = kinematics.inverse(np.random.default_rng(seed).uniform(-1.0, 1.0, 3))
    for dt_s in [DT_S] * 100 + [hung_s] + [DT_S] * 50:
        now_s += dt_s
        estimator.advance(now_s, board.read(now_s), setpoint, dt_s)
        if dt_s == hung_s:
            setpoint = np.zeros_like(setpoint)
        board.write(setpoint, now_s)
    true = board.truth(now_s).pose
    error = (true @ estimator.pose.inverse()).log()
    assert np.linalg.norm(error) < 2.0 * np.sqrt(np.trace(estimator.odometry(0).pose_covariance))
    assert np.linalg.norm(error) < 0.8
