"""Lag of a simulated roller platform behind its wheels, and its covariance.

There are no other errors: encoders are exact, and contacts have no random drift.
"""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tests.estimation.test_sensor_odometry import DT_S, Ride
from tsd_twin import robots
from tsd_twin.lie import Array, wrap
from tsd_twin.robots import OmniDescription
from tsd_twin.robots.omni import WheelNoise

NO_NOISE = WheelNoise(speed_scale_sigma=0.0, creep_m=0.0)


def platform(name: str, friction: float = 0.6, mass: float = 1.0) -> OmniDescription:
    robot = robots.description_of_kind(robots.load_robot(name), OmniDescription)
    heavy = msgspec.structs.replace(robot.mass, total_kg=mass * robot.mass.total_kg)
    drive = msgspec.structs.replace(robot.drive, friction=friction)
    return msgspec.structs.replace(robot, drive=drive, mass=heavy, noise=NO_NOISE, dead_wheels=None)


def rode(robot: OmniDescription, twists: list[Array]) -> tuple[Array, Array]:
    """Error (3,) of the estimate after a ride from rest, and its standard deviations (3,)."""
    ride = Ride(robot)
    ride.drive(np.zeros(3))
    for twist in twists:
        ride.drive(twist)
    estimate = ride.estimator.odometry(0)
    error = ride.simulation.pose.xy_heading - estimate.xy_heading
    error[2] = wrap(error[2])
    return error, np.sqrt(np.diag(estimate.pose_covariance))


def ramp(start: Array, end: Array, steps: int = 60) -> list[Array]:
    return [start + share * (end - start) for share in np.linspace(0.0, 1.0, steps)]


@pytest.mark.parametrize("name", ["kiwi", "omni4", "mecanum"])
@pytest.mark.parametrize("friction", [0.3, 0.8])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_after_a_start_it_is_behind_by_one_standard_deviation(
    name: str, friction: float, axis: int
) -> None:
    """The lag times the speed, for wheels whose friction is proportional to their creep.

    Speeds that change between two readings, 10 ms apart, add less than 1 ms to that.
    """
    robot = platform(name, friction)
    lag_s = robot.joint_errors().creep_lag_s
    assert lag_s is not None
    speed = np.array([0.4, 0.4, 1.0])[axis]
    twist = speed * np.eye(3)[axis]
    off, sigma = rode(robot, [*ramp(np.zeros(3), twist), *60 * [twist]])
    reckoned = lag_s[axis][axis] * speed
    assert off[axis] == pytest.approx(-reckoned, abs=1e-3 * speed)
    assert sigma[axis] == pytest.approx(reckoned, rel=0.02)


@pytest.mark.parametrize("name", ["kiwi", "mecanum"])
def test_a_stop_takes_it_back_and_a_reversal_does_as_much_again(name: str) -> None:
    robot, twist = platform(name), np.array([0.4, 0.0, 0.0])
    start = [*ramp(np.zeros(3), twist), *60 * [twist]]
    stop = [*ramp(twist, np.zeros(3)), *200 * [np.zeros(3)]]
    back = [*ramp(twist, -twist, 120), *60 * [-twist]]
    (once, _, _), _ = rode(robot, start)
    (rested, _, _), (sigma, _, _) = rode(robot, start + stop)
    assert abs(rested) < 0.1 * abs(once)
    # Friction of this plant is proportional to creep; where it saturates, a random quarter of the
    # creep does not cancel, which lasts 0.2 s in both accelerations of 0.6 s.
    assert sigma == pytest.approx(0.25 * abs(once) * np.sqrt(2.0 * 0.2 / 0.6), rel=0.15)
    (reversed_, _, _), (sigma, _, _) = rode(robot, start + back)
    assert reversed_ == pytest.approx(-once, rel=0.15)
    assert sigma == pytest.approx(abs(once), rel=0.2)


def test_the_lag_does_not_depend_on_the_mass_for_a_straight_way() -> None:
    """Twice the weight has twice the friction."""
    light, heavy = (platform("kiwi", mass=mass).joint_errors().creep_lag_s for mass in (1.0, 2.0))
    assert light is not None
    assert heavy is not None
    np.testing.assert_allclose(np.array(light)[:2], np.array(heavy)[:2], atol=1e-9)
    assert heavy[2][2] == pytest.approx(0.5 * light[2][2])


def test_dead_wheels_see_the_creep_and_their_gyro_what_it_misses_between_two_readings() -> None:
    """The turn starts abruptly, so a gyro sampled every 10 ms misses part of the heading change."""
    robot = robots.description_of_kind(robots.load_robot("omni4"), OmniDescription)
    assert robot.dead_wheels is not None
    exact = msgspec.structs.replace(
        robot.dead_wheels, gyro_drift_deg_per_h=0.0, radius_share=0.0, mounting_deg=0.0
    )
    robot = msgspec.structs.replace(robot, noise=NO_NOISE, dead_wheels=exact)
    twist = np.array([0.4, 0.0, 1.0])
    for steps in (10, 30, 60):
        off, sigma = rode(robot, [*ramp(np.zeros(3), twist, steps), *50 * [twist]])
        assert abs(off[2]) > 1e-5
        assert abs(off[2]) < 2.0 * sigma[2]
        assert sigma[2] < DT_S * twist[2]
        assert np.hypot(*off[:2]) < 3.0 * np.hypot(*sigma[:2])
