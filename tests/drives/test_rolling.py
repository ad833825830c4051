"""The kinematics against solid bodies: no contact slips, at rest in the gimbals or turning."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.drives.generated import directions, drives, joint_vectors, shares, size, within_limit
from tests.drives.rolling import gimbals, in_robot_frame, pivots, slip
from tsd_twin.drives import SingularityDrive
from tsd_twin.lie import Array

unhurried = settings(deadline=None)


def least_squares(drive: SingularityDrive, pivot_velocities: Array) -> tuple[Array, Array]:
    """Twist that fits velocities (k, 2) of the pivots in the robot frame best, and what is left."""
    rows = np.array([row for x, y, _ in pivots(drive) for row in ([1.0, 0.0, -y], [0.0, 1.0, x])])
    flat = pivot_velocities.reshape(-1)
    twist = np.linalg.lstsq(rows, flat, rcond=None)[0]
    return twist, flat - rows @ twist


@unhurried
@given(drive=drives(), direction=directions(), share=shares)
def test_no_wheel_slips(drive: SingularityDrive, direction: Array, share: float) -> None:
    """The wheels that the inverse kinematics tilt roll over the ground at every contact."""
    twist = within_limit(drive, direction, share)
    slipping = slip(drive, twist, drive.inverse(twist), np.zeros((drive.modules, 3)))
    assert np.abs(slipping).max() <= 1e-12 * size(drive, twist)


@unhurried
@given(drive=drives(), direction=directions(), share=shares)
def test_axles_and_tilts_are_those_of_the_rotation_matrices(
    drive: SingularityDrive, direction: Array, share: float
) -> None:
    twist = within_limit(drive, direction, share)
    joints = drive.inverse(twist)
    axles = np.array([gimbal[:, 2] for gimbal in gimbals(drive, joints)])
    tolerance = 1e-13 * share
    np.testing.assert_allclose(
        in_robot_frame(drive, drive.axles(twist)), axles[:, :2], rtol=0, atol=tolerance
    )
    tilts = np.arctan2(np.linalg.norm(axles[:, :2], axis=1), axles[:, 2])
    np.testing.assert_allclose(drive.tilt(joints), tilts, rtol=0, atol=tolerance)
    radii = drive.wheel_radius_m * np.linalg.norm(axles[:, :2], axis=1)
    np.testing.assert_allclose(
        drive.effective_radius_m(joints), radii, rtol=0, atol=drive.wheel_radius_m * tolerance
    )


@unhurried
@given(data=st.data())
def test_turning_gimbals_roll_too(data: st.DataObject) -> None:
    """Forward kinematics with rates, against rotation matrices differentiated in time."""
    drive = data.draw(drives())
    joints = data.draw(joint_vectors(drive))
    rates = data.draw(joint_vectors(drive)) * np.array([6.0, 6.0, 1.0])
    h = 1e-5
    before = gimbals(drive, joints - h * rates)
    after = gimbals(drive, joints + h * rates)
    turning = []
    for a, b, now in zip(before, after, gimbals(drive, joints), strict=True):
        skew = (b - a) / (2.0 * h) @ now.T
        turning.append([skew[2, 1], skew[0, 2], skew[1, 0]])
    # What a pivot at rest would drag its contact along with is how fast it moves when it does not.
    velocities = -slip(drive, np.zeros(3), joints.reshape(-1), np.array(turning))[:, :2]
    tolerance = 1e-6 * drive.wheel_radius_m
    np.testing.assert_allclose(
        in_robot_frame(drive, drive.contacts(joints.reshape(-1), rates.reshape(-1))),
        velocities,
        rtol=1e-9,
        atol=tolerance,
    )
    twist, residual = least_squares(drive, velocities)
    motion = drive.forward(joints.reshape(-1), rates.reshape(-1))
    # Modules close to one another see turning badly: allow for it.
    worst = 100.0 * tolerance / drive.pivot_radius_m
    np.testing.assert_allclose(motion.twist, twist, rtol=1e-9, atol=worst)
    np.testing.assert_allclose(
        in_robot_frame(drive, motion.residual.reshape(-1, 2)),
        residual.reshape(-1, 2),
        rtol=1e-9,
        atol=100.0 * tolerance,
    )
