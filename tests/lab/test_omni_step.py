"""Full speed and stop: the profile is time-optimal, and the robot follows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.experiment_runs import is_picture, run, table
from tsd_twin.errors import TwinError
from tsd_twin.lab.papers import PointToPointProfile
from tsd_twin.lie import Array

limits = st.floats(0.2, 10.0)


def area(y: Array, x: Array) -> float:
    """Area under a curve, by trapezia."""
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)))


@given(distance=st.floats(0.05, 50.0), top=limits, up=limits, down=limits)
def test_a_dash_covers_its_distance_and_keeps_its_limits(
    distance: float, top: float, up: float, down: float
) -> None:
    dash = PointToPointProfile(distance, top, up, down)
    t = np.linspace(0.0, dash.duration_s, 20_001)
    speed = dash.speed(t)
    assert speed.max() <= min(top, dash.peak_mps) * (1.0 + 1e-12)
    assert area(speed, t) == pytest.approx(distance, rel=1e-4)
    slopes = np.diff(speed) / np.diff(t)
    assert slopes.max() <= up * (1.0 + 1e-6)
    assert slopes.min() >= -down * (1.0 + 1e-6)
    before = t <= dash.duration_s - dash.peak_mps / down
    assert area(speed[before], t[before]) == pytest.approx(
        dash.brake_at_m, abs=0.01 * top + 1e-3 * distance
    )


@given(distance=st.floats(0.05, 50.0), top=limits, same=limits)
def test_with_one_limit_both_ways_a_triangle_brakes_half_way(
    distance: float, top: float, same: float
) -> None:
    dash = PointToPointProfile(distance, top, same, same)
    if dash.is_triangle:
        assert dash.brake_at_m == pytest.approx(0.5 * distance)
        assert dash.duration_s == pytest.approx(2.0 * np.sqrt(distance / same))
    else:
        assert dash.peak_mps == top
        assert dash.duration_s == pytest.approx(distance / top + top / same)


def test_the_robot_follows_triangle_and_trapezoid_and_slips_without_limits(tmp_path: Path) -> None:
    lines = run(tmp_path, "omni-step")
    assert [line.split(":")[0] for line in lines] == ["triangle", "trapezoid", "unlimited step"]
    assert is_picture(tmp_path / "omni-step.png")
    for name, peak in (("triangle", np.sqrt(2.5 * 6.0)), ("trapezoid", 5.0)):
        columns = table(tmp_path / f"omni-step_{name}.csv")
        assert columns["true_mps"].max() == pytest.approx(peak, abs=0.06)
        # A lag of 30 ms is up to 0.1 m/s on a slope of 2.5 m/s^2, and delays the end.
        rising = columns["t_s"] < 1.5
        off = columns["true_mps"] - columns["ideal_mps"]
        assert np.abs(off[rising]).max() < 0.15
        assert np.abs(off).max() < 0.3
        assert columns["true_mps"][-1] == pytest.approx(0.0, abs=1e-3)
    unlimited = table(tmp_path / "omni-step_unlimited.csv")
    slope = unlimited["true_mps"][50] / unlimited["t_s"][50]
    # Four wheels at 45 degrees, sliding: mu g / sqrt 2.
    assert slope == pytest.approx(0.7 * 9.81 / np.sqrt(2.0), rel=0.03)
    assert (unlimited["rim_mps"] - unlimited["true_mps"]).max() > 4.0


@pytest.mark.parametrize("flag", ["--speed", "--acceleration"])
@pytest.mark.parametrize("number", ["0", "-1", "nan", "inf"])
def test_flags_that_make_no_sense_are_refused(tmp_path: Path, flag: str, number: str) -> None:
    with pytest.raises(TwinError, match=f"{flag}: .* above 0"):
        run(tmp_path, "omni-step", f"{flag}={number}")
