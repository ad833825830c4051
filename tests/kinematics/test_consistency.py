"""Inconsistent modules leave a residual, which the faulty module explains."""

from __future__ import annotations

import numpy as np
import pytest
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
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array


@given(
    kinematics=drives(fewest=3),
    direction=directions(),
    share=shares,
    off=st.one_of(st.floats(0.01, 0.3), st.floats(-0.3, -0.01)),
    data=st.data(),
)
def test_one_module_that_disagrees_is_seen_and_blamed(
    kinematics: SingularityKinematics,
    direction: Array,
    share: float,
    off: float,
    data: st.DataObject,
) -> None:
    """Without the faulty module no residual remains, so it explains the most."""
    joints = kinematics.inverse(within_limit(kinematics, direction, share)).reshape(-1, 3)
    guilty = data.draw(st.integers(0, kinematics.modules - 1))
    joints[guilty, data.draw(st.integers(0, 1))] += off
    residual = kinematics.forward(joints.reshape(-1)).residual
    speed = kinematics.wheel_radius_m * abs(kinematics.spin_rad_per_s)
    assert np.linalg.norm(residual) > 1e-3 * abs(off) * speed
    fault_contribution = kinematics.fault_contribution(residual)
    assert fault_contribution[guilty] == pytest.approx(residual @ residual, rel=1e-6)
    assert fault_contribution.max() <= fault_contribution[guilty] * (1.0 + 1e-6)


@given(data=st.data())
def test_blame_is_what_leaving_a_module_out_takes_off_the_residual(data: st.DataObject) -> None:
    kinematics = data.draw(drives())
    joints = data.draw(joint_vectors(kinematics)).reshape(-1)
    residual = kinematics.forward(joints).residual
    h = kinematics.contact_from_twist
    v = kinematics.contacts(joints)
    for i, fault_contribution in enumerate(kinematics.fault_contribution(residual)):
        rest = [j for j in range(kinematics.modules) if j != i]
        rows, values = h[rest].reshape(-1, 3), v[rest].reshape(-1)
        left = values - rows @ np.linalg.lstsq(rows, values, rcond=None)[0]
        taken = residual @ residual - left @ left
        # Squares of the smallest numbers underflow.
        tolerance = max(1e-9 * (v * v).sum(), np.finfo(float).tiny)
        assert fault_contribution == pytest.approx(taken, rel=1e-6, abs=tolerance)


@given(kinematics=drives(), direction=directions(), share=shares, droop=st.floats(0.0, 1.0))
def test_the_same_droop_of_all_spins_leaves_no_residual(
    kinematics: SingularityKinematics, direction: Array, share: float, droop: float
) -> None:
    """Hence the name consistency monitor instead of slip sensor."""
    twist = within_limit(kinematics, direction, share)
    joints = kinematics.inverse(twist).reshape(-1, 3)
    joints[:, 2] *= 1.0 - droop
    motion = kinematics.forward(joints.reshape(-1))
    tolerance = 1e-11 * size(kinematics, twist)
    assert np.abs(motion.residual).max() <= tolerance
    np.testing.assert_allclose(motion.twist[:2], twist[:2] * (1.0 - droop), rtol=0, atol=tolerance)
