"""The linear fit of Table 2 as an explanation of the square of the thesis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from research.budget import spin_error_of_line
from research.thesis import HYPOTHESES, SPEEDS_RPM, drive_squares, robot_at
from tests.support.experiment_runs import is_picture, run
from tsd_twin.lab.square import THESIS_SHARE


@pytest.mark.parametrize(
    ("speed_rpm", "excess_percent"),
    [(3000, [8.6, 11.8, 7.4]), (5000, [3.2, 5.8, 6.3]), (6000, [3.4, -0.3, 5.5])],
)
def test_line_makes_wheels_fast_by_the_table(speed_rpm: float, excess_percent: list[float]) -> None:
    found = 100.0 * spin_error_of_line(robot_at(speed_rpm))
    assert found == pytest.approx(excess_percent, abs=0.06)


def test_line_explains_error_and_speed_and_friction_the_error() -> None:
    table, line, slippery, _ = (drive_squares(each, 5000.0, 60, 9) for each in HYPOTHESES)
    assert np.median(table.line_m) < 0.7 * THESIS_SHARE
    assert np.median(line.line_m) == pytest.approx(THESIS_SHARE, rel=0.15)
    assert np.median(slippery.line_m) == pytest.approx(THESIS_SHARE, rel=0.25)
    assert np.median(line.speed_mps) > 1.02
    assert np.median(table.speed_mps) < 1.0
    assert np.median(slippery.speed_mps) < 0.95
    assert np.median(line.turned_rad) > np.median(table.turned_rad)


def test_study_prints_a_row_for_each_speed(tmp_path: Path) -> None:
    lines = run(tmp_path, "thesis", "--runs", "2")
    assert sum("rpm  " in line for line in lines) == (1 + len(HYPOTHESES)) * len(SPEEDS_RPM)
    assert is_picture(tmp_path / "thesis.png")
    assert len((tmp_path / "thesis.csv").read_text().splitlines()) == 1 + len(SPEEDS_RPM)
