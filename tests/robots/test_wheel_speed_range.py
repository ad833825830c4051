"""Effects of the wheel speed, against manual calculations and rolling."""

from __future__ import annotations

import numpy as np
import pytest

from tsd_twin import robots

RPM = np.pi / 30.0
ROBOT = robots.load_robot("tsd")
GEARS = ROBOT.wheel_speed_range


@pytest.mark.parametrize(
    ("rpm", "top_mps"),
    [(2500.0, 5.24), (3000.0, 6.28), (2000.0, 4.19)],
)
def test_figures_worked_by_hand(rpm: float, top_mps: float) -> None:
    """With r_w = 40 mm and 30 degrees; the rim moves at 2 pi 0.04 rpm / 60 m/s."""
    assert GEARS.top_speed_mps(rpm * RPM) == pytest.approx(top_mps, abs=0.005)


def test_robots_whose_wheels_stand_when_they_do_have_no_wheel_speed_range() -> None:
    for name in ("omni4", "kiwi", "mecanum", "atlas"):
        assert robots.load_robot(name).wheel_speed_range is None
