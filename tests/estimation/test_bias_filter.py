"""Biases are estimated from poses and a gyro, with consistent sigmas."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.estimation import BiasFilter, TwistErrors
from tsd_twin.estimation.bias_filter import CAUTION
from tsd_twin.estimation.sensor_correction import LinearReading
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.topics import SENSOR_POSE, Sample
from tsd_twin.robots import SingularityDescription
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.sensors.pose import Camera, CameraNoise
from tsd_twin.simulation import simulate

DT_S = 0.01
NOISE = np.diag([0.005, 0.005, 0.02]) ** 2
MOUNTING = np.hstack([np.zeros((3, 4)), np.diag([0.01, 0.01, 0.009])])
WHITE_PER_S = np.diag([1e-6, 1e-6, 1e-6])


def bias_jacobian(twist: Array) -> Array:
    """Jacobian (3, 7): speed scale, two creep velocities, turn rate; the mounting has no effect."""
    columns = np.column_stack([0.03 * twist * [1, 1, 0], np.diag([0.005, 0.005, 0.01])])
    return np.hstack([columns, np.zeros((3, 3))])


class Ride:
    """A robot with biases, and a filter that estimates them."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.biases = self.random.standard_normal(7)
        self.filter = BiasFilter(7)
        self.truth = SE2.identity()
        self.now_s = 0.0
        self.sizes = self.random.uniform(0.3, 0.8, 3)
        self.seen: list[tuple[float, SE2]] = []

    def drive(self, seconds: float, late: int = 2) -> None:
        """Drive; every fourth pose is observed and delivered `late` poses later."""
        for i in range(round(seconds / DT_S)):
            if i % 10 == 0:
                waves = np.sin(np.array([1.0, 1.7, 0.9]) * self.now_s + [1.0, 0.0, 0.5])
                self.twist = self.sizes * waves
                self.errors = TwistErrors(bias_jacobian(self.twist), WHITE_PER_S, np.zeros((3, 3)))
            speed, omega = np.hypot(*self.twist[:2]), self.twist[2]
            own_per_s = np.square(CAUTION * np.array([speed, speed, omega]))
            spread = np.sqrt((np.diag(WHITE_PER_S) + own_per_s) / DT_S)
            noise = spread * self.random.standard_normal(3)
            true = self.twist + self.errors.bias_jacobian @ self.biases + noise
            self.truth = self.truth @ SE2.exp(DT_S * true)
            self.now_s += DT_S
            self.filter.follow(self.now_s, self.twist, self.errors)
            if i % 4 == 0:
                self.seen.append((self.now_s, self.see()))
                if len(self.seen) > late:
                    self.hear(*self.seen.pop(0))

    def see(self) -> SE2:
        noise = np.sqrt(np.diag(NOISE)) * self.random.standard_normal(3)
        return SE2(self.truth.xy_heading + MOUNTING @ self.biases + noise)

    def hear(self, at_s: float, pose: SE2) -> None:
        self.filter.fuse_pose(pose, NOISE, MOUNTING, at_s)

    @property
    def off(self) -> Array:
        """(7,): errors in units of sigma."""
        sigma = np.sqrt(np.diag(self.filter.covariance))
        return (self.filter.biases - self.biases) / sigma


def test_biases_are_within_three_sigma_and_better_known_by_driving() -> None:
    rides = [Ride(seed) for seed in range(24)]
    before: float = 1.0
    for _ in range(2):
        for ride in rides:
            ride.drive(6.0)
        off = np.array([ride.off[:4] for ride in rides])
        assert (np.abs(off) < 3.0).mean() > 0.96
        assert 0.6 < np.sqrt(np.square(off).mean()) < 1.4
        sigma = np.mean([np.sqrt(np.diag(ride.filter.covariance)[:4]) for ride in rides])
        assert sigma < 0.85 * before
        before = float(sigma)


def test_a_carried_robot_keeps_what_it_has_learned() -> None:
    ride = Ride(3)
    ride.drive(8.0)
    known = np.diag(ride.filter.covariance).copy()
    ride.truth = SE2(ride.truth.xy_heading + np.array([1.0, -2.0, 1.0]))
    ride.seen.clear()
    ride.drive(4.0)
    assert np.abs(ride.off).max() < 3.5
    assert (np.diag(ride.filter.covariance)[:4] < 1.5 * known[:4]).all()


def test_a_pose_older_than_the_last_changes_nothing() -> None:
    ride = Ride(4)
    ride.drive(2.0, late=0)
    before = ride.filter.biases.copy()
    ride.hear(ride.now_s - 0.5, SE2.identity())
    assert (ride.filter.biases == before).all()


def comparison(difference: float, by_bias: float, variance: float) -> LinearReading:
    by, covariance = np.array([[by_bias]]), np.array([[variance]])
    return LinearReading(np.array([difference]), np.zeros((1, 3)), by, covariance)


def test_what_nothing_measures_changes_by_itself_only_towards_the_description() -> None:
    """Over hours without measurements, the estimate returns to the prior."""
    filtered = BiasFilter(1)
    filtered.compare(0.0, comparison(2.0, 1.0, 1e-6))
    assert filtered.biases == pytest.approx([2.0], abs=1e-3)
    filtered.compare(7200.0, comparison(0.0, 0.0, 1.0))
    assert filtered.biases == pytest.approx([0.0], abs=1e-3)
    assert filtered.covariance == pytest.approx(np.eye(1), abs=1e-3)


TSD = robots.description_of_kind(robots.load_robot("tsd"), SingularityDescription)


_SPIN_UP_S = 6.0


def wander(
    robot: SingularityDescription, seconds: float, seed: int
) -> tuple[StateEstimator, dict[str, float]]:
    """Drive a simulated robot under a camera; return its estimator and true errors."""
    simulation = simulate(robot, noise=1.0, seed=seed)
    estimator, kinematics = StateEstimator(robot), robot.kinematics()
    camera = Camera(CameraNoise(), np.random.default_rng(seed))
    setpoint = np.zeros(9)
    start, at_rest = SE2.identity(), list[float]()
    for i in range(round((_SPIN_UP_S + seconds) / DT_S)):
        now_s, driven_s = (i + 1) * DT_S, max(i * DT_S - _SPIN_UP_S, 0.0)
        simulation.advance(DT_S)
        measured = simulation.measure()
        measured[2:9:3] = np.nan
        estimator.advance(now_s, measured, setpoint, DT_S)
        if not setpoint.any():
            at_rest.append(float(measured[9]))
        if driven_s == 0.0:
            start = SE2(simulation.pose.xy_heading)
            estimator.set_pose(SE2.identity())
        else:
            frames = camera.capture(now_s, start.inverse() @ simulation.pose)
            poses = [
                PoseStamped.planar(SE2(frame.pose), round(1e9 * frame.taken_s)) for frame in frames
            ]
            heard = [Sample(SENSOR_POSE.key(robot.name), encode_pose(pose), b"") for pose in poses]
            estimator.pose_sensor.receive(heard, now_s, round(1e9 * now_s))
            estimator.pose_sensor.step(now_s, at_rest=False)
        wave = min(driven_s, 1.0) * np.array(
            [0.6, 0.3 * np.sin(driven_s), 0.5 * np.cos(0.7 * driven_s)]
        )
        setpoint = np.zeros(9) if i * DT_S < 0.6 * _SPIN_UP_S else kinematics.inverse(wave)
        simulation.command(setpoint)
    shares = simulation.joints[2::3] / setpoint[2::3] - 1.0
    errors = {f"module{i + 1}_wheel_share": share for i, share in enumerate(shares.tolist())}
    return estimator, errors | {"gyro_bias_rad_per_s": float(np.mean(at_rest))}


def test_the_core_learns_wheel_speeds_and_the_bias_of_a_gyro() -> None:
    robot = msgspec.structs.replace(TSD, gyro=Gyro())
    for seed in (21, 22):
        estimator, errors = wander(robot, 6.0, seed)
        learned = estimator.learned()
        assert learned is not None
        for name, error in errors.items():
            found = learned[name]
            assert abs(found.value - error) < 3.5 * found.sigma, name
            is_share = name.endswith("share")
            size = robot.joint_errors().speed_scale_sigma if is_share else Gyro().bias_rad_per_s
            assert found.sigma < 0.7 * size, name


def test_without_other_sensors_nothing_is_learned() -> None:
    assert StateEstimator(TSD).learned() is None
