"""Robots not built as described: mounting angles, wheel positions, slopes, gyro scales."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.kinematics import ContactLayout
from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.simulation import simulate

ROBOTS = 400
TWIST = np.array([0.3, 0.2, 0.6])
ARMING_S, DRIVING_S = 2.5, 1.0


def built(name: str, **errors: float) -> Any:
    robot: Any = robots.load_robot(name)
    exact = robot.with_errors(0.0)
    return msgspec.structs.replace(exact, errors=msgspec.structs.replace(exact.errors, **errors))


def solved(places: Array, angles: Array, rolls: Array, rims: Array) -> Array:
    """Twist of wheels that impose `rims` cos(roll) along axles at angles, by least squares."""
    rows = np.stack(
        [
            np.cos(angles),
            np.sin(angles),
            places[:, 0] * np.sin(angles) - places[:, 1] * np.cos(angles),
        ],
        axis=-1,
    )
    return np.linalg.lstsq(rows, rims * np.cos(rolls), rcond=None)[0]


@pytest.mark.parametrize("name", ["kiwi", "omni4", "mecanum"])
def test_slopes_of_a_layout_are_the_derivatives_of_least_squares(name: str) -> None:
    kinematics: Any = robots.load_robot(name).kinematics()
    layout: ContactLayout = kinematics.contact_layout
    places, rolls = kinematics.positions_m, kinematics.rollers_rad
    angles = kinematics.directions_rad + rolls
    rims = kinematics.wheel_radius_m * kinematics.inverse(TWIST)
    np.testing.assert_allclose(solved(places, angles, rolls, rims), TWIST, atol=1e-12)
    slopes, step = layout.slopes(TWIST), 1e-6
    for i in range(len(places)):
        unit = step * np.eye(len(places))[i]
        changed = [
            (places, angles + unit, rolls),
            (places, angles + unit, rolls + unit),
            (places + np.outer(unit, [1.0, 0.0]), angles, rolls),
            (places + np.outer(unit, [0.0, 1.0]), angles, rolls),
        ]
        for j, (there, turned, rolled) in enumerate(changed):
            if j == 1 and not rolls.any():
                continue
            found = (solved(there, turned, rolled, rims) - TWIST) / step
            np.testing.assert_allclose(slopes[:, 4 * i + j], found, atol=1e-4)


@pytest.mark.parametrize("name", ["tsd", "kiwi", "mecanum"])
@pytest.mark.parametrize("key", ["mount_deg", "place_m"])
def test_robots_are_spread_as_their_description_says(name: str, key: str) -> None:
    """The twists of many simulated robots against the estimate's covariance."""
    robot = built(name, **{key: 0.5 if key == "mount_deg" else 0.002})
    kinematics = robot.kinematics()
    simulation = simulate(robot, (ROBOTS,), seed=3, errors=1.0)
    for twist, seconds in ((np.zeros(3), ARMING_S), (TWIST, DRIVING_S)):
        joints = kinematics.inverse(twist)
        if name == "tsd" and not twist.any():
            joints[2::3] = 0.0
        simulation.command(joints)
        simulation.advance(seconds)
    found = np.cov(simulation.twist().T)
    errors = robot.joint_errors()
    one = [errors.mount_rad, errors.mount_rad, errors.place_m, errors.place_m]
    by = kinematics.contact_layout.slopes(TWIST) * np.tile(one, len(kinematics.actuators))
    expected = by @ by.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(found - expected).max() > 0.0
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.25)


def test_robots_as_described_move_as_before() -> None:
    for name in ("tsd", "kiwi"):
        one, other = (simulate(built(name), (3,), seed=3, errors=scale) for scale in (0.0, 1.0))
        for simulation in (one, other):
            simulation.command(robots.load_robot(name).kinematics().inverse(TWIST))
            simulation.advance(1.0)
        np.testing.assert_array_equal(one.pose.xy_heading, other.pose.xy_heading)


def test_wheels_with_rollers_creep_down_a_slope_as_far_as_their_grip_lets_them() -> None:
    """Downhill force over friction per creep, plus the yielding of the motors."""
    robot = built("kiwi", slope_deg=1.0)
    simulation = simulate(robot, (20,), seed=3, errors=1.0)
    simulation.advance(2.0)
    push = 9.81 * np.sin(np.radians(1.0))
    lag_s = robot.joint_errors().creep_lag_s[0][0]
    rolled = robot.kinematics().forward(simulation.joints).twist
    speeds = np.hypot(*(simulation.twist() - rolled)[:, :2].T)
    np.testing.assert_allclose(speeds, push * lag_s, rtol=0.1)
    headings = np.arctan2(*simulation.pose.xy_heading[:, 1::-1].T)
    assert np.ptp(headings) > np.pi


def test_a_robot_on_spinning_wheels_slides_down_a_slope() -> None:
    """Compares with the lag on its floor plus the compliance of its gimbals."""
    robot = built("tsd", slope_deg=1.0)
    simulation = simulate(robot, seed=3, errors=1.0, plant="mujoco")
    joints = robot.kinematics().inverse(np.zeros(3))
    for setpoint, seconds in ((0.0 * joints, ARMING_S), (joints, 2.0)):
        simulation.command(setpoint)
        simulation.advance(seconds)
    push = 9.81 * np.sin(np.radians(1.0))
    speed = float(np.hypot(*simulation.twist()[:2]))
    assert 0.8 * push * robot.slip_lag_s < speed < 3.0 * push * robot.slip_lag_s


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_gyros_are_off_by_a_fraction_of_the_turn_rate(noise: float) -> None:
    gyro = Gyro(noise_rad_per_s=1e-9, bias_rad_per_s=0.0, scale_share=0.01)
    robot: RobotDescription = msgspec.structs.replace(built("kiwi"), gyro=gyro)
    simulation = simulate(robot, (ROBOTS,), seed=3, noise=noise)
    simulation.command(robot.kinematics().inverse(np.array([0.0, 0.0, 2.0])))
    simulation.advance(1.0)
    shares = simulation.measure()[:, -1] / simulation.twist()[:, 2] - 1.0
    assert shares.std() == pytest.approx(noise * 0.01, rel=0.1, abs=1e-12)
