"""The kinematics against rigid bodies: contacts do not slip, with gimbals fixed or turning."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.random_kinematics import (
    directions,
    drives,
    joint_vectors,
    shares,
    size,
    within_limit,
)
from tests.kinematics.rigid_wheels import gimbals, in_robot_frame, pivots, slip
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array


def least_squares(
    kinematics: SingularityKinematics, pivot_velocities: Array
) -> tuple[Array, Array]:
    """Best-fit twist for pivot velocities (k, 2) in the robot frame, and the residual."""
    rows = np.array(
        [row for x, y, _ in pivots(kinematics) for row in ([1.0, 0.0, -y], [0.0, 1.0, x])]
    )
    flat = pivot_velocities.reshape(-1)
    twist = np.linalg.lstsq(rows, flat, rcond=None)[0]
    return twist, flat - rows @ twist


@given(kinematics=drives(), direction=directions(), share=shares)
def test_no_wheel_slips(kinematics: SingularityKinematics, direction: Array, share: float) -> None:
    """Wheels tilted by the inverse kinematics roll without slip at every contact."""
    twist = within_limit(kinematics, direction, share)
    slipping = slip(kinematics, twist, kinematics.inverse(twist), np.zeros((kinematics.modules, 3)))
    assert np.abs(slipping).max() <= 1e-12 * size(kinematics, twist)


@given(kinematics=drives(), direction=directions(), share=shares)
def test_axles_and_tilts_are_those_of_the_rotation_matrices(
    kinematics: SingularityKinematics, direction: Array, share: float
) -> None:
    twist = within_limit(kinematics, direction, share)
    joints = kinematics.inverse(twist)
    axles = np.array([gimbal[:, 2] for gimbal in gimbals(kinematics, joints)])
    tolerance = 1e-13 * share
    np.testing.assert_allclose(
        in_robot_frame(kinematics, kinematics.axles(twist)), axles[:, :2], rtol=0, atol=tolerance
    )
    tilts = np.arctan2(np.linalg.norm(axles[:, :2], axis=1), axles[:, 2])
    np.testing.assert_allclose(kinematics.tilt(joints), tilts, rtol=0, atol=tolerance)
    radii = kinematics.wheel_radius_m * np.linalg.norm(axles[:, :2], axis=1)
    np.testing.assert_allclose(
        kinematics.effective_radius_m(joints),
        radii,
        rtol=0,
        atol=kinematics.wheel_radius_m * tolerance,
    )


@given(data=st.data())
def test_turning_gimbals_roll_too(data: st.DataObject) -> None:
    """Forward kinematics with rates, against numerical derivatives of rotation matrices."""
    kinematics = data.draw(drives())
    joints = data.draw(joint_vectors(kinematics))
    rates = data.draw(joint_vectors(kinematics)) * np.array([6.0, 6.0, 1.0])
    h = 1e-5
    before = gimbals(kinematics, joints - h * rates)
    after = gimbals(kinematics, joints + h * rates)
    turning = []
    for a, b, now in zip(before, after, gimbals(kinematics, joints), strict=True):
        skew = (b - a) / (2.0 * h) @ now.T
        turning.append([skew[2, 1], skew[0, 2], skew[1, 0]])
    # The contact velocity for a fixed pivot equals the pivot velocity without slip, negated.
    velocities = -slip(kinematics, np.zeros(3), joints.reshape(-1), np.array(turning))[:, :2]
    tolerance = 1e-6 * kinematics.wheel_radius_m
    np.testing.assert_allclose(
        in_robot_frame(kinematics, kinematics.contacts(joints.reshape(-1), rates.reshape(-1))),
        velocities,
        rtol=1e-9,
        atol=tolerance,
    )
    twist, residual = least_squares(kinematics, velocities)
    motion = kinematics.forward(joints.reshape(-1), rates.reshape(-1))
    # Modules close together observe turning badly, so allow for it.
    worst = 100.0 * tolerance / kinematics.pivot_radius_m
    np.testing.assert_allclose(motion.twist, twist, rtol=1e-9, atol=worst)
    np.testing.assert_allclose(
        in_robot_frame(kinematics, motion.residual.reshape(-1, 2)),
        residual.reshape(-1, 2),
        rtol=1e-9,
        atol=100.0 * tolerance,
    )
