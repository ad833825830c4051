"""The plant against wheels rolling in three dimensions, integrated in much smaller steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import load_robot
from tsd_twin.simulation import rolling_tangent

DRIVE = load_robot("tsd").kinematics()
Trajectory = Callable[[float], tuple[Array, Array]]
"""Joints (k, 3) and their rates (k, 3) at a time."""


def rolling_twist(drive: SingularityKinematics, joints: Array, rates: Array) -> Array:
    """Least-squares twist of a chassis whose wheels do not slip, from rigid bodies alone.

    Each wheel turns about its axle and both gimbal axes; its contact point must be at rest.
    """
    rows, velocities = [], []
    for azimuth, (alpha, beta, spin), (alpha_rate, beta_rate, _) in zip(
        drive.azimuths_rad, joints, rates, strict=True
    ):
        c, s = np.cos(azimuth), np.sin(azimuth)
        outward, tangential, up = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, 1.0]])
        # The outer gimbal turns about `outward` and takes the inner axis with it.
        inner_axis = np.cos(beta) * tangential - np.sin(beta) * up
        post = np.sin(beta) * tangential + np.cos(beta) * up
        axle = np.cos(alpha) * post + np.sin(alpha) * outward
        turning = spin * axle + beta_rate * outward - alpha_rate * inner_axis
        velocities.append(-np.cross(turning, -drive.wheel_radius_m * up)[:2])
        x, y = drive.pivot_radius_m * c, drive.pivot_radius_m * s
        rows += [[1.0, 0.0, -y], [0.0, 1.0, x]]
    return np.linalg.lstsq(np.array(rows), np.concatenate(velocities), rcond=None)[0]


def in_small_steps(trajectory: Trajectory, end_s: float, steps: int) -> Array:
    """Fourth-order Runge-Kutta on x, y and heading in the world."""

    def velocity(t: float, pose: Array) -> Array:
        vx, vy, omega = rolling_twist(DRIVE, *trajectory(t))
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([c * vx - s * vy, s * vx + c * vy, omega])

    pose, h = np.zeros(3), end_s / steps
    for i in range(steps):
        t = i * h
        k1 = velocity(t, pose)
        k2 = velocity(t + h / 2, pose + h / 2 * k1)
        k3 = velocity(t + h / 2, pose + h / 2 * k2)
        k4 = velocity(t + h, pose + h * k3)
        pose = pose + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return pose


def by_plant(trajectory: Trajectory, end_s: float, steps: int) -> Array:
    pose, h = SE2.identity(), end_s / steps
    for i in range(steps):
        nodes = [trajectory((i + part) * h)[0].reshape(-1) for part in (0.0, 0.5, 1.0)]
        pose = pose @ SE2.exp(rolling_tangent(DRIVE, np.array(nodes), h))
    return pose.xy_heading


def wobble(t: float) -> tuple[Array, Array]:
    """Tilts that swing at servo speed, and varying spins, different for each module."""
    frequency = np.array([[7.0, 9.0, 1.0], [11.0, 6.0, 2.0], [8.0, 10.0, 1.5]])
    phase = np.array([[0.0, 1.0, 2.0], [0.7, 2.1, 0.3], [1.9, 0.2, 1.1]])
    size = np.array([0.4, 0.4, 60.0])
    offset = np.array([-0.1, 0.05, 260.0])
    joints = offset + size * np.sin(frequency * t + phase)
    return joints, size * frequency * np.cos(frequency * t + phase)


def test_the_plant_rolls_as_solid_bodies_do() -> None:
    """0.5 s of fast motion that ends 0.2 m away, with the control period of 10 ms."""
    expected = in_small_steps(wobble, 0.5, 500)
    assert np.hypot(*expected[:2]) > 0.2
    np.testing.assert_allclose(by_plant(wobble, 0.5, 50), expected, rtol=0, atol=2e-6)


def test_the_plant_is_of_fourth_order() -> None:
    """Half the step gives a sixteenth of the error."""
    expected = in_small_steps(wobble, 0.4, 800)
    coarse, fine = (np.abs(by_plant(wobble, 0.4, steps) - expected).max() for steps in (20, 40))
    assert 12.0 < coarse / fine < 20.0


def swing(sizes: Array) -> Trajectory:
    """Gimbals swing while the wheels do not spin, so only the rates move the robot."""

    def trajectory(t: float) -> tuple[Array, Array]:
        joints = np.zeros((3, 3))
        rates = np.zeros((3, 3))
        joints[:, :2] = np.sin(5.0 * t) * sizes
        rates[:, :2] = 5.0 * np.cos(5.0 * t) * sizes
        return joints, rates

    return trajectory


def test_a_gimbal_that_comes_back_brings_the_robot_back() -> None:
    """Rates integrate to the angle for any step size, so a swing causes no creep."""
    for axis in ([0.5, 0.0], [0.0, 0.5]):
        for steps in (7, 40):
            end = by_plant(swing(np.tile(axis, (3, 1))), 2.0 * np.pi / 5.0, steps)
            np.testing.assert_allclose(end, 0.0, rtol=0, atol=1e-15)


def test_a_gimbal_rolls_the_robot_by_its_arc() -> None:
    """Turning all outer gimbals by 0.5 rad turns the robot by the arc over the pivot radius."""
    for steps in (1, 7):
        end = by_plant(swing(np.tile([0.0, 0.5], (3, 1))), np.pi / 10.0, steps)
        turn = -0.5 * DRIVE.wheel_radius_m / DRIVE.pivot_radius_m
        np.testing.assert_allclose(end, [0.0, 0.0, turn], rtol=0, atol=1e-15)


@pytest.mark.parametrize("twist", [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.3, -0.2, 2.0]])
def test_a_constant_twist_is_exact_over_any_step(twist: list[float]) -> None:
    joints = np.tile(DRIVE.inverse(np.array(twist)), (3, 1))
    moved = SE2.exp(rolling_tangent(DRIVE, joints, 3.0))
    expected = SE2.exp(np.array(twist) * 3.0)
    np.testing.assert_allclose(moved.xy_heading, expected.xy_heading, rtol=0, atol=1e-13)


def test_a_batch_is_its_members() -> None:
    joints = np.stack(
        [np.stack([wobble(t + u)[0].reshape(-1) for u in range(4)]) for t in range(3)]
    )
    together = rolling_tangent(DRIVE, joints, 0.01)
    for i in range(4):
        np.testing.assert_allclose(
            together[i], rolling_tangent(DRIVE, joints[:, i], 0.01), rtol=1e-12, atol=1e-15
        )
