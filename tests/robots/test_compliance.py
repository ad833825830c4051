"""Gimbal compliance of a description, by hand and against the numbers in the docs."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.robots import SingularityDescription

ROBOT = robots.load_robot("tsd")
assert isinstance(ROBOT, SingularityDescription)
COMPLIANCE = ROBOT.joint_compliance()
STIFFNESS_NM = 29.1


def test_a_push_leans_gimbals_as_the_docs_say() -> None:
    """4 m/s^2 is 4 N per wheel, and 5.5 mrad in total: sides of a right triangle per module."""
    lean = COMPLIANCE.by_acceleration @ np.array([4.0, 0.0, 0.0])
    assert np.hypot(lean[0::3], lean[1::3]) == pytest.approx(np.full(3, 0.0055), rel=0.01)
    assert not lean[2::3].any()


def test_a_push_leans_a_gimbal_across_itself() -> None:
    """Forward, the floor pushes wheels forward at their lowest points, so their axles tip back.

    The first module is on the left, so its X points forward: `beta` tilts the wheel sideways
    and moves it.
    """
    lean = COMPLIANCE.by_acceleration @ np.array([4.0, 0.0, 0.0])
    assert lean[0] == pytest.approx(0.0, abs=1e-12)
    assert lean[1] == pytest.approx(-4.0 * 0.04 / STIFFNESS_NM, rel=0.01)


def test_translations_lean_all_gimbals_alike_and_turns_do_not() -> None:
    drive = ROBOT.kinematics()
    for acceleration, contradicts in ([4.0, -2.0, 0.0], False), ([0.0, 0.0, 20.0], True):
        lean = COMPLIANCE.by_acceleration @ np.array(acceleration)
        residual = drive.forward(drive.inverse(np.zeros(3)) + lean).residual
        assert (np.abs(residual).max() > 0.01) == contradicts


def test_slip_pushes_as_far_as_friction_goes() -> None:
    """A slip as fast as the patch turns meets 71 % of the friction; extrapolated linearly, all."""
    spin_rad_per_s = 262.0
    slip_mps = COMPLIANCE.spin_to_slip_m * spin_rad_per_s
    lean = COMPLIANCE.by_slip(spin_rad_per_s)[:, 0] * slip_mps
    force_n = 0.8 * 9.81
    assert np.abs(lean).max() == pytest.approx(force_n * 0.04 / STIFFNESS_NM, rel=0.01)
    assert not COMPLIANCE.by_slip(0.0).any()


def test_a_floor_without_friction_pushes_nothing() -> None:
    floor = msgspec.structs.replace(ROBOT.floor, friction=0.0)
    smooth = msgspec.structs.replace(ROBOT, floor=floor)
    assert not smooth.joint_compliance().by_slip(262.0).any()
