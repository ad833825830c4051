"""Odometry from a gyro or dead wheels, compared with wheel odometry and with lost sensors."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.estimation import sensor_odometry_of
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import OmniDescription, RobotDescription
from tsd_twin.simulation import Simulation, simulate

OMNI = robots.load_robot("omni4")
ATLAS = robots.load_robot("atlas")
DT_S = 0.01


def slippery(robot: OmniDescription, slip: float) -> OmniDescription:
    return msgspec.structs.replace(robot, drive=msgspec.structs.replace(robot.drive, slip=slip))


class Ride:
    """A simulated robot that is driven, and its estimator."""

    def __init__(
        self, robot: RobotDescription, seed: int = 0, noise: float = 0.0, plant: str = "kinematic"
    ) -> None:
        self.robot = robot
        self.simulation: Simulation = simulate(robot, seed=seed, noise=noise, plant=plant)
        # The bus of a robot simulated without errors has no delay.
        self.estimator = StateEstimator(robot.with_delay(0.0))
        self.now_s = 0.0
        self.path_m = 0.0
        self.deaf = False

    def drive(self, twist: Array) -> None:
        setpoint = self.simulation.kinematics.inverse(twist)
        before = self.simulation.pose
        self.simulation.command(setpoint)
        self.simulation.advance(DT_S)
        self.now_s += DT_S
        measured = self.simulation.measure()
        if not self.robot.measures_spin:
            measured[: len(setpoint)][~self.estimator.is_angle] = np.nan
        if self.deaf:
            measured[len(setpoint) :] = np.nan
        self.estimator.advance(self.now_s, measured, setpoint, DT_S)
        if isinstance(before, SE2):
            step = self.simulation.pose.xy_heading - before.xy_heading
            self.path_m += float(np.hypot(*step[:2]))

    def off_m(self) -> tuple[float, float]:
        """Position error of the better and of the other estimate."""
        true = self.simulation.pose.xy_heading
        other = self.estimator.alternative_odometry(0)
        assert other is not None
        best = self.estimator.odometry(0)
        errors = [float(np.hypot(*(o.xy_heading - true)[:2])) for o in (best, other)]
        return errors[0], errors[1]


def wander(now_s: float) -> Array:
    """A winding path at about 1 m/s."""
    start = min(1.0, now_s)
    return start * np.array([1.0, 0.3 * np.sin(now_s), 0.5 * np.cos(0.7 * now_s)])


@pytest.mark.parametrize("seed", range(3))
def test_dead_wheels_and_gyro_know_where_the_robot_is_when_its_wheels_slip(seed: int) -> None:
    """20 m at 10 % slip, with noise: within 0.5 % of the path; the driven wheels are 5 % off."""
    ride = Ride(slippery(OMNI, 0.1), seed, noise=1.0)
    while ride.path_m < 20.0:
        ride.drive(wander(ride.now_s))
    best_m, wheels_m = ride.off_m()
    assert best_m < 0.005 * 20.0
    assert wheels_m > 0.05 * 20.0


def test_without_slip_and_noise_both_agree_with_the_truth() -> None:
    ride = Ride(OMNI)
    while ride.path_m < 5.0:
        ride.drive(wander(ride.now_s))
    best_m, wheels_m = ride.off_m()
    assert best_m < 0.01
    assert wheels_m < 0.05  # Creep during acceleration and turns.


def test_while_the_sensors_are_lost_the_driven_wheels_fill_in() -> None:
    ride = Ride(OMNI)
    for _ in range(200):
        ride.drive(wander(ride.now_s))
    ride.deaf = True
    for _ in range(200):
        ride.drive(wander(ride.now_s))
    ride.deaf = False
    for _ in range(200):
        ride.drive(wander(ride.now_s))
    assert ride.off_m()[0] < 0.05
    assert np.isfinite(ride.estimator.odometry(0).pose_covariance).all()


def test_the_covariance_of_the_dead_wheels_is_the_smaller_one() -> None:
    ride = Ride(OMNI)
    for _ in range(500):
        ride.drive(wander(ride.now_s))
    other = ride.estimator.alternative_odometry(0)
    assert other is not None
    best = np.diag(ride.estimator.odometry(0).pose_covariance)
    assert (best > 0.0).all()
    assert (best < np.diag(other.pose_covariance)).all()


def test_a_robot_without_them_has_one_estimate() -> None:
    for name in ("tsd", "kiwi", "mecanum"):
        assert sensor_odometry_of(robots.load_robot(name)) == (None, False)
        assert StateEstimator(robots.load_robot(name)).alternative_odometry(0) is None


def test_both_estimates_are_set_to_a_pose() -> None:
    ride = Ride(OMNI)
    for _ in range(50):
        ride.drive(np.array([0.5, 0.0, 0.5]))
    where = np.array([3.0, -1.0, 2.0])
    ride.estimator.set_pose(SE2(where))
    other = ride.estimator.alternative_odometry(0)
    assert other is not None
    for message in (ride.estimator.odometry(0), other):
        np.testing.assert_array_equal(message.xy_heading, where)
        assert not message.pose_covariance.any()


# The sphere.


def turned_apart_deg(a: Array, b: SO3) -> float:
    return float(np.degrees(np.linalg.norm((SO3(a) @ b.inverse()).log())))


def roll(ride: Ride, seconds: float) -> None:
    for _ in range(round(seconds / DT_S)):
        s = ride.now_s
        ride.drive(np.array([1.0 + np.sin(s), np.cos(s), 0.5]))


@pytest.mark.parametrize(("model", "best"), [("dual", 0.2), ("ideal", 10.0)])
def test_the_model_that_is_named_makes_the_estimate_and_the_other_stands_beside_it(
    model: str, best: float
) -> None:
    """In 10 s the ideal model is off by degrees, the model with rows by a tenth of a degree."""
    robot = msgspec.structs.replace(
        ATLAS, estimate=msgspec.structs.replace(ATLAS.estimate, model=model)
    )
    ride = Ride(robot)
    roll(ride, 10.0)
    other = ride.estimator.alternative_odometry(0)
    odometry = ride.estimator.odometry(0)
    assert other is not None
    assert odometry.wxyz is not None
    assert other.wxyz is not None
    errors = {
        model: turned_apart_deg(odometry.wxyz, ride.simulation.pose),
        ({"dual", "ideal"} - {model}).pop(): turned_apart_deg(other.wxyz, ride.simulation.pose),
    }
    assert errors["dual"] < 0.2
    assert 1.0 < errors["ideal"] < 10.0
    assert errors[model] < best


def test_the_covariance_of_a_sphere_is_what_noise_makes_of_it() -> None:
    """Wheels with a constant relative error."""
    robot = msgspec.structs.replace(
        ATLAS, noise=msgspec.structs.replace(ATLAS.noise, speed_scale_sigma=0.02)
    )
    drive, random = robot.kinematics(), np.random.default_rng(2)
    twist, runs = np.array([0.8, -0.4, 1.0]), 150
    ends = []
    speeds = drive.inverse(twist)
    for _ in range(runs):
        wrong = speeds * (1.0 + 0.02 * random.standard_normal(3))
        pose = drive.integrate(SO3.identity(), drive.forward(wrong).twist, 3.0)
        ends.append((pose @ drive.integrate(SO3.identity(), twist, 3.0).inverse()).log())
    estimator = StateEstimator(
        msgspec.structs.replace(
            robot, estimate=msgspec.structs.replace(robot.estimate, model="ideal")
        )
    )
    for i in range(300):
        estimator.advance(0.01 * (i + 1), speeds, speeds, 0.01)
    covariance = estimator.odometry(0).pose_covariance
    found = np.std(ends, axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), found, rtol=0.25)
    squared = np.einsum("ij,jk,ik->i", ends, np.linalg.inv(covariance), ends)
    assert 2.3 < squared.mean() < 3.7
