"""The sphere in virtual time changes rows, independent of the controller's model."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from tests.support.matrices import so3_matrix
from tsd_twin import robots
from tsd_twin.lie import Array
from tsd_twin.simulation import simulate

ROBOT = robots.load_robot("atlas")
IDEAL = msgspec.structs.replace(
    ROBOT, drive=msgspec.structs.replace(ROBOT.drive, row_distance_m=0.0)
)


def reference(speeds: Array, seconds: float, steps: int) -> Array:
    """Rotation matrix of the sphere at constant wheel speeds, by Eq. 8 to 12 and 25 written out."""
    share = 12.5 / (2.0 * (150.0 + 4.85))
    theta, matrix, dt = math.radians(40.0), np.eye(3), seconds / steps
    for n in range(steps):
        rows = []
        for i, az in enumerate(np.radians([0.0, 120.0, 240.0])):
            index = math.floor((8.0 * speeds[i] * (n + 0.5) * dt / math.pi) % 2.0) + 1
            to = np.array([math.cos(az), math.sin(az)])
            ideal = np.array([*(math.sin(theta) * to), math.cos(theta)])
            hop = np.array([*(math.cos(theta) * to), -math.sin(theta)])
            rows.append(6.0 * (math.sqrt(1 - share**2) * ideal + (-1) ** index * share * hop))
        x, y, z = np.linalg.solve(np.array(rows), speeds) * dt
        skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        matrix = (np.eye(3) + skew + 0.5 * skew @ skew) @ matrix
    return matrix


@pytest.mark.parametrize("speeds", [[2.0, 1.0, -3.0], [5.0, 5.0, 5.0], [0.0, 0.3, 7.0]])
def test_it_turns_as_the_rows_make_it(speeds: list[float]) -> None:
    """A stiff motor makes the speeds constant from the start."""
    stiff = msgspec.structs.replace(
        ROBOT, motor=msgspec.structs.replace(ROBOT.motor, time_constant_s=1e-6, power_w=1e6)
    )
    simulation = simulate(stiff)
    simulation.command(np.array(speeds))
    simulation.advance(3e-5)
    for _ in range(200):
        simulation.advance(0.01)
    expected = reference(np.array(speeds), 2.0, 20_000)
    np.testing.assert_allclose(so3_matrix(simulation.pose), expected, atol=2e-3)
    ideal = simulate(stiff).kinematics.twist_from_speeds @ np.array(speeds)
    assert np.linalg.norm(simulation.twist() - ideal) > 1e-3


def test_without_a_distance_between_rows_it_turns_as_commanded() -> None:
    simulation = simulate(IDEAL)
    twist = np.array([0.5, -0.4, 1.0])
    simulation.command(simulation.kinematics.inverse(twist))
    for _ in range(300):
        simulation.advance(0.01)
    np.testing.assert_allclose(simulation.twist(), twist, atol=1e-9)
    simulation.command(np.zeros(3))
    for _ in range(300):
        simulation.advance(0.01)
    turned = twist * 3.0
    length = np.linalg.norm(turned)
    expected = turned / length * (length - 2.0 * np.pi * round(length / (2.0 * np.pi)))
    np.testing.assert_allclose(simulation.pose.log(), expected, atol=1e-6)
    assert not simulation.joints.any()


def test_a_batch_is_its_members() -> None:
    twists = np.random.default_rng(0).normal(size=(30, 4, 3))
    together, alone = simulate(ROBOT, (4,)), [simulate(ROBOT) for _ in range(4)]
    for twist in twists:
        together.command(together.kinematics.inverse(twist))
        together.advance(0.01)
        for one, mine in zip(alone, twist, strict=True):
            one.command(one.kinematics.inverse(mine))
            one.advance(0.01)
    for i, one in enumerate(alone):
        np.testing.assert_allclose(together.pose.wxyz[i], one.pose.wxyz, rtol=0, atol=1e-12)
        np.testing.assert_allclose(together.measure()[i], one.measure(), rtol=1e-12)


def test_motors_have_a_torque_and_a_top_speed() -> None:
    simulation = simulate(ROBOT)
    simulation.command(np.full(3, 1e4))
    simulation.advance(0.005)
    motor = ROBOT.motor
    # Inertia is largest about a horizontal axis: 2/5 m R^2 over (R / r)^2 3/2 sin^2 40 degrees.
    sphere = 0.4 * 2.5 * 0.15**2 / (36.0 * 1.5 * math.sin(math.radians(40.0)) ** 2)
    inertia = 2e-6 * 14.0**2 + 0.5 * 0.08 * 0.025**2 + sphere
    torque = 4.0 * 20.0 / (6000.0 * 2.0 * np.pi / 60.0) * 14.0
    assert simulation.joints.max() == pytest.approx(0.005 * torque / inertia, rel=1e-6)
    for _ in range(500):
        simulation.advance(0.01)
    top = 6000.0 * 2.0 * np.pi / 60.0 / 14.0
    assert simulation.joints.max() == pytest.approx(top, rel=1e-3)
    assert motor.top_speed_rad_per_s == pytest.approx(top)


def test_facts_say_which_row_carries() -> None:
    simulation = simulate(ROBOT)
    assert simulation.hardware_status()["rows"] == [1, 1, 1]
    simulation.command(np.array([1.0, 0.0, -1.0]))
    for _ in range(60):  # 0.6 rad minus the start, beyond pi / 8.
        simulation.advance(0.01)
    assert simulation.hardware_status()["rows"] == [2, 1, 1]
