"""Heading accuracy of a singularity robot with a yaw gyro, and without gyro readings."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from tests.estimation.test_sensor_odometry import DT_S, Ride, wander
from tsd_twin import robots
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.estimation import GyroOdometry
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.robots import OmniDescription, SingularityDescription
from tsd_twin.sensors.gyro import Gyro

TSD = robots.description_of_kind(robots.load_robot("tsd"), SingularityDescription)
GYRO = Gyro(scale_share=0.0)
ROBOT = msgspec.structs.replace(TSD, gyro=GYRO)


def wrong_wheels() -> SingularityDescription:
    noise = msgspec.structs.replace(TSD.noise, speed_scale_sigma=0.05)
    return msgspec.structs.replace(ROBOT, noise=noise)


def ready(
    robot: SingularityDescription, seed: int = 0, noise: float = 1.0, plant: str = "kinematic"
) -> Ride:
    """A robot at rest with its wheels at speed, and an estimator with the true pose."""
    ride = Ride(robot, seed, noise, plant)
    ride.simulation.command(np.where(ride.estimator.is_angle, ride.simulation.joints, 0.0))
    ride.simulation.advance(2.0)
    for _ in range(200):
        ride.drive(np.zeros(3))
    ride.estimator.set_pose(ride.simulation.pose)
    return ride


def heading_off(ride: Ride) -> tuple[float, float]:
    """Heading error of the published and of the alternative estimate."""
    true = ride.simulation.pose.xy_heading[2]
    best, other = (float(wrap(pose.xy_heading[2] - true)) for pose in poses(ride))
    return best, other


def poses(ride: Ride) -> tuple[SE2, SE2]:
    """Published pose, and pose from wheel odometry alone."""
    other = ride.estimator.alternative_odometry(0)
    assert other is not None
    return SE2(ride.estimator.odometry(0).xy_heading), SE2(other.xy_heading)


def drive_20_m(ride: Ride) -> float:
    """Drive a winding path, and return its duration."""
    start_s, way_m = ride.now_s, ride.path_m
    while ride.path_m < way_m + 20.0:
        ride.drive(wander(ride.now_s - start_s))
    return ride.now_s - start_s


def test_of_wheels_that_are_wrong_the_heading_is_off_by_the_bias_of_the_gyro_and_no_more() -> None:
    """20 m with turns, wheel speeds off by 5 %; the gyro bias is measured at rest.

    The tolerance is 4 sigma of gyro noise, plus the small weight of the wheels.
    """
    offs, shares = [], []
    for seed in range(6):
        ride = ready(wrong_wheels(), seed)
        bias = np.mean([ride.simulation.measure()[-1] for _ in range(4000)])
        took_s = drive_20_m(ride)
        off, wheels = heading_off(ride)
        random = 4.0 * GYRO.noise_rad_per_s * math.sqrt(took_s * DT_S)
        assert abs(off - bias * took_s) < random + 0.005 * abs(wheels)
        assert abs(off) < abs(wheels)
        offs.append((off, wheels, *ride.off_m()))
        claimed = math.sqrt(ride.estimator.odometry(0).pose_covariance[2, 2])
        assert 1.0 < claimed / (GYRO.bias_rad_per_s * took_s) < 1.5
        shares.append(off / claimed)
    gyro, wheels, gyro_m, wheels_m = np.sqrt(np.square(offs).mean(axis=0))
    assert gyro < 0.1 * wheels
    assert gyro_m < 0.1 * wheels_m
    # Chi-square with six degrees of freedom: one in 10,000 is outside, at either end.
    assert 0.1 < np.square(shares).sum() < 27.9


@pytest.mark.parametrize("name", ["kiwi", "mecanum"])
def test_a_platform_on_wheels_keeps_its_heading_by_a_gyro_too(name: str) -> None:
    """20 m with turns and a 1 % wheel error; at rest, the gyro bias does not turn the estimate."""
    robot = robots.description_of_kind(robots.load_robot(name), OmniDescription)
    offs = []
    for seed in range(4):
        ride = Ride(msgspec.structs.replace(robot, gyro=GYRO), seed, 1.0)
        for _ in range(200):
            ride.drive(np.zeros(3))
        assert not ride.estimator.odometry(0).xy_heading.any()
        drive_20_m(ride)
        off, wheels = heading_off(ride)
        claimed = math.sqrt(ride.estimator.odometry(0).pose_covariance[2, 2])
        offs.append((off, wheels, off / claimed))
    by_gyro, by_wheels, share = np.sqrt(np.square(offs).mean(axis=0))
    assert by_gyro < 0.15 * by_wheels
    assert 0.2 < share < 2.4


def test_without_noise_both_agree_with_the_truth() -> None:
    ride = ready(ROBOT, noise=0.0)
    drive_20_m(ride)
    off, wheels = heading_off(ride)
    assert abs(off) < 1e-3
    assert abs(wheels) < 0.01  # Servo steps.


def test_the_gyro_leads_on_the_physics_plant_too() -> None:
    ride = ready(ROBOT, seed=1, plant="mujoco")
    for _ in range(500):
        ride.drive(wander(ride.now_s))
    assert abs(heading_off(ride)[0]) < 4.0 * GYRO.bias_rad_per_s * 5.0


@pytest.mark.parametrize("reading", [[], [np.nan], [np.inf], [-np.inf], [1e300], [-40.0]])
def test_a_gyro_that_tells_nothing_leaves_the_wheels(reading: list[float]) -> None:
    """Also if values are missing or beyond the range of gyros."""
    ride = ready(ROBOT, seed=2)
    pose = ride.simulation.pose
    estimator = StateEstimator(ROBOT)
    estimator.set_pose(pose)
    for i in range(300):
        setpoint = ride.simulation.kinematics.inverse(wander(DT_S * i))
        ride.simulation.command(setpoint)
        ride.simulation.advance(DT_S)
        measured = np.append(ride.simulation.measure()[: len(setpoint)], reading)
        estimator.advance(DT_S * (i + 1), measured, setpoint, DT_S)
    best, wheels = estimator.odometry(0), estimator.alternative_odometry(0)
    assert wheels is not None
    np.testing.assert_array_equal(best.xy_heading, wheels.xy_heading)
    np.testing.assert_array_equal(best.twist, wheels.twist)
    np.testing.assert_allclose(best.pose_covariance, wheels.pose_covariance, rtol=0.1, atol=1e-9)
    assert estimator.sensors.shape == (1,)


def test_only_the_steps_without_a_reading_are_those_of_the_wheels() -> None:
    ride = ready(wrong_wheels(), seed=3)

    def steps() -> tuple[Array, Array]:
        before = poses(ride)
        ride.drive(wander(2.0 + ride.now_s))
        first, other = (a.inverse() @ b for a, b in zip(before, poses(ride), strict=True))
        return first.xy_heading, other.xy_heading

    for i in range(300):
        ride.deaf = i % 7 == 3
        best, wheels = steps()
        same = bool(np.allclose(best, wheels, rtol=0.0, atol=1e-12))
        assert same is ride.deaf or i < 10  # Covariances are evaluated at 10 Hz.
    assert np.isfinite(ride.estimator.odometry(0).pose_covariance).all()


def test_while_the_wheels_are_shut_off_the_bias_turns_nothing() -> None:
    """The wheels imply rest; an hour of integrated bias would be a third of a turn."""
    gyro = msgspec.structs.replace(GYRO, bias_rad_per_s=0.05)
    ride = Ride(msgspec.structs.replace(ROBOT, gyro=gyro), seed=1, noise=1.0)
    shut_off = np.where(ride.estimator.is_angle, ride.simulation.joints, 0.0)
    for _ in range(1000):
        ride.simulation.advance(DT_S)
        ride.now_s += DT_S
        measured = ride.simulation.measure()
        assert abs(measured[-1]) > 0.001
        ride.estimator.advance(ride.now_s, measured, shut_off, DT_S)
    assert abs(heading_off(ride)[0]) < 1e-9


def test_a_robot_that_turns_while_its_wheels_have_stopped_is_followed_by_the_gyro() -> None:
    """On ice, wheels claim anything from the end of a turn to a turn to the other side.

    The fused turn rate lies between the rates from wheels and gyro.
    """
    kinematics = TSD.kinematics()
    for by_wheels in np.linspace(1.0, -1.0, 21):
        odometry = GyroOdometry(ROBOT, GYRO)
        for turn_rate in (2.0, by_wheels):
            joints = kinematics.inverse(np.array([0.0, 0.0, turn_rate]))
            motion = kinematics.forward(joints, np.zeros_like(joints))
            for _ in range(20):
                odometry.follow(joints, np.array([2.0]), motion, DT_S)
                fused = float(odometry.motion.twist[2])
                assert min(turn_rate, 2.0) - 1e-6 <= fused <= 2.0 + 1e-6
                assert np.linalg.norm(odometry.motion.twist[:2]) < 0.1
