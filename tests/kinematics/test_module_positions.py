"""Modules at any positions, against rigid-body velocities and rolling spheres.

The reference uses no code of the package: a point of a body moves at v + omega x r, and a sphere
that spins about its axle at `spin` rolls at spin axle x (radius up).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.support.robot_variants import placed
from tsd_twin.estimation import PlanarOdometry
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import JointErrors

calm = settings(max_examples=60)
coordinates = st.floats(-1.0, 1.0)


@st.composite
def layouts(draw: st.DrawFn) -> Array:
    """Two to six positions, at least 0.1 m apart, some with one in the centre."""
    count = draw(st.integers(2, 6))
    points = [(draw(coordinates), draw(coordinates)) for _ in range(count)]
    if draw(st.booleans()):
        points[0] = (0.0, 0.0)
    at = np.array(points)
    apart = np.linalg.norm(at[:, None] - at, axis=-1) + np.eye(count)
    assume(apart.min() > 0.1)
    return at


@st.composite
def twists(draw: st.DrawFn) -> Array:
    """Twists (3,) up to 2 m/s and 4 rad/s: some within the tilt limit, some far beyond."""
    share = draw(st.sampled_from([0.01, 0.2, 1.0]))
    return share * np.array([draw(coordinates), draw(coordinates), 2.0 * draw(coordinates)]) * 2.0


def drive_at(points: Array) -> SingularityKinematics:
    return placed([(float(x), float(y)) for x, y in points]).kinematics()


def rigid_body(points: Array, twist: Array) -> Array:
    """Velocities (k, 2) of points of a body: v + omega x r."""
    r = np.column_stack([points, np.zeros(len(points))])
    return (np.append(twist[:2], 0.0) + np.cross([0.0, 0.0, twist[2]], r))[:, :2]


def rolling(drive: SingularityKinematics, points: Array, joints: Array) -> Array:
    """Velocities (..., k, 2) of the wheel centres: spin axle x (radius up), by the gimbal frames.

    The outer gimbal turns by beta about the direction from the centre to the pivot; the inner one
    by -alpha about the axis that is tangential at rest.
    """
    modules = joints.reshape(-1, len(points), 3)
    velocities = np.empty((*modules.shape[:2], 2))
    for i, (x, y) in enumerate(points):
        heading = np.arctan2(y, x) if np.hypot(x, y) > 0.0 else 0.0
        mounted = Rotation.from_euler("z", heading - 0.5 * np.pi)
        alpha, beta, spin = modules[:, i].T
        tilted = Rotation.from_euler("YX", np.column_stack([beta, -alpha]))
        axle = (mounted * tilted).apply([0.0, 0.0, 1.0])
        up = np.array([0.0, 0.0, drive.wheel_radius_m])
        velocities[:, i] = np.cross(spin[:, None] * axle, up)[:, :2]
    return velocities.reshape(*joints.shape[:-1], len(points), 2)


@calm
@example(np.array([[-0.0, 0.0], [0.0, 1.0]]), np.array([0.0, 0.02, 0.0]))
@given(layouts(), twists())
def test_wheels_roll_with_the_body_at_every_position(points: Array, twist: Array) -> None:
    drive = drive_at(points)
    reached = drive.limit(twist)
    joints = drive.inverse(twist)
    expected = rigid_body(points, reached)
    np.testing.assert_allclose(rolling(drive, points, joints), expected, atol=1e-12)


@calm
@given(layouts(), twists())
def test_forward_inverts_inverse(points: Array, twist: Array) -> None:
    drive = drive_at(points)
    reached = drive.limit(twist)
    solution = drive.forward(drive.inverse(reached))
    np.testing.assert_allclose(solution.twist, reached, atol=1e-11)
    np.testing.assert_allclose(solution.residual, 0.0, atol=1e-11)


@calm
@given(layouts(), twists())
def test_no_module_tilts_beyond_its_limit_and_the_direction_stays(
    points: Array, twist: Array
) -> None:
    drive = drive_at(points)
    tilts = drive.tilt(drive.inverse(twist))
    assert tilts.max() <= drive.max_tilt_rad + 1e-12
    speeds = np.linalg.norm(rigid_body(points, twist), axis=1)
    needed = speeds.max() / (drive.wheel_radius_m * drive.spin_rad_per_s)
    assert drive.joint_utilization(twist) == pytest.approx(needed / np.sin(drive.max_tilt_rad))
    reached = drive.limit(twist)
    if needed > 0.0:
        share = min(1.0, float(np.sin(drive.max_tilt_rad) / needed))
        np.testing.assert_allclose(reached, share * twist, atol=1e-12)


@settings(max_examples=15)
@given(layouts(), twists())
def test_covariance_of_the_twist_matches_random_errors(points: Array, twist: Array) -> None:
    """With random gimbal zero errors: least squares over rigid-body rows, 20,000 times."""
    drive, sigma, count = drive_at(points), 1e-3, 20_000
    odometry = PlanarOdometry(drive, JointErrors(zero_rad=sigma))
    joints = drive.inverse(drive.limit(twist))
    for _ in range(3):
        odometry.advance(joints, 0.01)
    rows = np.stack([rigid_body(points, unit).ravel() for unit in np.eye(3)], axis=-1)
    angles = np.tile([1.0, 1.0, 0.0], len(points))
    off = sigma * np.random.default_rng(0).standard_normal((count, len(joints))) * angles
    measured = rolling(drive, points, joints + off).reshape(count, -1)
    solved = np.linalg.lstsq(rows, measured.T, rcond=None)[0]
    expected = np.cov(solved)
    scale = np.sqrt(np.diag(expected))
    claimed = odometry.twist_covariance / np.outer(scale, scale)
    np.testing.assert_allclose(claimed, expected / np.outer(scale, scale), atol=0.06)


@calm
@given(st.lists(st.floats(0.5, 1.5), min_size=2, max_size=4), st.floats(0.2, 1.0), twists())
def test_positions_on_a_circle_are_the_short_form(
    gaps: list[float], radius_m: float, twist: Array
) -> None:
    azimuths = np.cumsum(gaps)
    points = radius_m * np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    placed_drive = drive_at(points)
    short = dataclasses.replace(placed_drive, azimuths_rad=azimuths, pivot_radius_m=radius_m)
    np.testing.assert_allclose(placed_drive.pivots_m, short.pivots_m, atol=1e-15)
    np.testing.assert_allclose(placed_drive.inverse(twist), short.inverse(twist), atol=1e-12)
    residual = np.linspace(-0.1, 0.1, 2 * len(points))
    np.testing.assert_allclose(
        placed_drive.fault_contribution(residual), short.fault_contribution(residual), atol=1e-9
    )
