"""Exaggerated tilt keeps the lean direction and multiplies its angle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.scene.robot_visual import MOST_TILT_RAD, exaggerate_tilt
from tsd_twin.dashboard.wire.view import TiltFactor
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array

tilts = st.floats(1e-6, math.radians(80.0))
leans = st.floats(-math.pi, math.pi)


def joints_of(tilt: float, lean: float) -> Array:
    """Joints of a module whose axle has this tilt and lean direction, by spherical trigonometry."""
    x, y, z = math.sin(tilt) * math.cos(lean), math.sin(tilt) * math.sin(lean), math.cos(tilt)
    return np.array([math.asin(y), math.atan2(x, z), 7.0])


def axle(joints: Array) -> Array:
    alpha, beta, _ = joints
    return np.array(
        [math.cos(alpha) * math.sin(beta), math.sin(alpha), math.cos(alpha) * math.cos(beta)]
    )


@given(tilt=tilts, lean=leans, factor=st.sampled_from(list(TiltFactor)))
def test_the_axle_leans_in_the_same_direction_a_multiple_as_far(
    tilt: float, lean: float, factor: TiltFactor
) -> None:
    drawn = exaggerate_tilt(joints_of(tilt, lean), factor.number)
    x, y, z = axle(drawn)
    expected = max(tilt, min(factor.number * tilt, MOST_TILT_RAD))
    assert math.atan2(math.hypot(x, y), z) == pytest.approx(expected, rel=1e-9)
    assert math.cos(math.atan2(y, x) - lean) == pytest.approx(1.0, abs=1e-9)
    assert drawn[2] == 7.0


@given(tilt=tilts, lean=leans)
def test_the_factor_one_changes_nothing(tilt: float, lean: float) -> None:
    joints = joints_of(tilt, lean)
    assert exaggerate_tilt(joints, 1.0) == pytest.approx(joints, abs=1e-12)


def test_an_upright_axle_stays_upright_and_modules_do_not_mix() -> None:
    upright = np.zeros(3)
    leaning = joints_of(math.radians(4.0), 1.0)
    drawn = exaggerate_tilt(np.concatenate([upright, leaning]), 10.0)
    assert np.array_equal(drawn[:3], upright)
    assert drawn[3:] == pytest.approx(joints_of(math.radians(40.0), 1.0), abs=1e-12)


def test_the_tilt_that_is_drawn_is_the_one_of_the_kinematics() -> None:
    drive = SingularityKinematics(
        azimuths_rad=np.radians([90.0, 210.0, 330.0]),
        pivot_radius_m=0.15,
        wheel_radius_m=0.04,
        spin_rad_per_s=261.8,
        max_tilt_rad=math.radians(30.0),
        max_tilt_rate_rad_per_s=6.6,
    )
    joints = drive.inverse(np.array([0.3, -0.2, 0.5]))
    drawn = exaggerate_tilt(joints, 3.0)
    assert drive.tilt(drawn) == pytest.approx(3.0 * drive.tilt(joints), rel=1e-9)
