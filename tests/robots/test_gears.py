"""What a speed of the wheels gives and costs, against figures worked by hand, and rolling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin import robots

RPM = np.pi / 30.0
ROBOT = robots.load("tsd")
GEARS = ROBOT.gears


@pytest.mark.parametrize(
    ("rpm", "top_mps", "step_mmps", "tilt_deg"),
    [(2500.0, 5.24, 16.1, 5.48), (3000.0, 6.28, 19.3, 4.56), (2000.0, 4.19, 12.9, 6.86)],
)
def test_figures_worked_by_hand(
    rpm: float, top_mps: float, step_mmps: float, tilt_deg: float
) -> None:
    """Of r_w = 40 mm, 30 degrees and 4,096 steps; the rim moves at 2 pi 0.04 rpm / 60 m/s."""
    assert GEARS.top_speed_mps(rpm * RPM) == pytest.approx(top_mps, abs=0.005)
    assert 1000.0 * GEARS.step_mps(rpm * RPM) == pytest.approx(step_mmps, abs=0.05)
    assert np.degrees(GEARS.tilt_rad(rpm * RPM, 1.0)) == pytest.approx(tilt_deg, abs=0.005)


@given(wanted=st.floats(0.0, 40.0))
def test_the_slowest_wheel_that_reaches_a_speed_is_chosen(wanted: float) -> None:
    spin = GEARS.spin_for(wanted)
    assert GEARS.refusal(spin) == ""
    reached = GEARS.top_speed_mps(spin)
    if spin > 2000.0 * RPM * (1 + 1e-9):
        assert reached <= wanted * (1 + 1e-9)
    if spin < 13409.0 * RPM * (1 - 1e-9):
        assert reached >= wanted * (1 - 1e-9)


@given(spin=st.floats(2000.0 * RPM, 13409.0 * RPM), share=st.floats(0.01, 1.0))
def test_a_tilt_gives_the_speed_that_it_is_for(spin: float, share: float) -> None:
    """By the forward kinematics, which know nothing of gears: straight ahead, all lean alike."""
    speed = share * GEARS.top_speed_mps(spin)
    drive = ROBOT.kinematics().with_spin(spin)
    joints = drive.inverse(np.array([speed, 0.0, 0.0]))
    np.testing.assert_allclose(drive.tilt(joints), GEARS.tilt_rad(spin, speed), atol=1e-7)
    np.testing.assert_allclose(drive.forward(joints).twist, [speed, 0.0, 0.0], atol=1e-9)


def test_a_speed_faster_than_the_rim_takes_no_tilt() -> None:
    assert np.isnan(GEARS.tilt_rad(2000.0 * RPM, 9.0))


def test_robots_whose_wheels_stand_when_they_do_have_no_gears() -> None:
    for name in ("omni4", "kiwi", "mecanum", "atlas"):
        assert robots.load(name).gears is None
