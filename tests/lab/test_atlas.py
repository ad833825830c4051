"""Fig. 7 of Weiss et al. 2008, against its equations written out for one mounting."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.support.experiment_runs import is_picture, run, table
from tsd_twin import robots
from tsd_twin.errors import RobotFileError, TwinError
from tsd_twin.lab.papers import row_effect


def test_it_prints_the_peaks_of_the_paper_and_leaves_both_curves(tmp_path: Path) -> None:
    text = "\n".join(run(tmp_path, "atlas"))
    assert "peak angle     3.15 deg" in text
    assert "peak magnitude 3.79 %" in text
    assert is_picture(tmp_path / "atlas.png")
    columns = table(tmp_path / "atlas.csv")
    assert (columns["t_s"][0], columns["t_s"][-1]) == (0.0, 13.0)
    assert columns["angle_deg"].max() == pytest.approx(3.2, abs=0.05)
    assert columns["share_percent"].max() == pytest.approx(3.8, abs=0.05)


def test_without_a_distance_between_the_rows_both_are_zero(tmp_path: Path) -> None:
    text = "\n".join(run(tmp_path, "atlas", "--row-distance-mm", "0"))
    assert "peak angle     0.00 deg" in text
    assert "peak magnitude 0.00 %" in text
    columns = table(tmp_path / "atlas.csv")
    np.testing.assert_allclose(columns["angle_deg"], 0.0, atol=1e-9)
    np.testing.assert_allclose(columns["share_percent"], 0.0, atol=1e-9)


@pytest.mark.parametrize("t_s", [0.05, 0.777, 2.5, 5.3, 8.25, 11.9])
def test_at_any_time_it_is_what_the_equations_give(t_s: float) -> None:
    """Eq. 8 to 12, 25 and 26, with angles by many small steps of the inputs."""
    times = [0.0, 0.1, *range(1, 14)]
    inputs = [
        [1, 1, 1, 2, 2, 0, 1, 0, 1, 2, 1, 2, 3, 3, 0],
        [0, 1, 2, 1, 1, 0, 0, 1, 2, 1, 3, 3, 1, 2, 0],
        [0, 1, 2, 1, 2, 1, 0, 0, 3, 3, 2, 1, 2, 1, 0],
    ]
    fine = (np.arange(40_000) + 0.5) * t_s / 40_000
    phi = np.array([np.interp(fine, times, row).mean() * t_s for row in inputs])
    speeds = np.array([np.interp(t_s, times, row) for row in inputs])
    theta, share = math.radians(40.0), 12.5 / (2.0 * (150.0 + 4.85))
    ideal, true = [], []
    for i, az in enumerate(np.radians([0.0, 120.0, 240.0])):
        s, c, to = math.sin(theta), math.cos(theta), np.array([math.cos(az), math.sin(az)])
        sign = (-1.0) ** (math.floor((8.0 * phi[i] / math.pi) % 2.0) + 1)
        row = np.array([*(s * to), c])
        ideal.append(6.0 * row)
        hop = sign * share * np.array([*(c * to), -s])
        true.append(6.0 * (math.sqrt(1.0 - share**2) * row + hop))
    effect = row_effect(robots.load_robot("atlas").kinematics())
    at = round(1000 * t_s)
    np.testing.assert_allclose(
        effect.ideal[at], np.linalg.solve(np.array(ideal), speeds), atol=1e-9
    )
    np.testing.assert_allclose(effect.true[at], np.linalg.solve(np.array(true), speeds), atol=1e-9)


def test_another_kind_of_robot_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match=r"drive\.kind is omni \(sphere is needed here\)"):
        run(tmp_path, "atlas", "--robot", "kiwi")


def test_rows_farther_apart_than_the_sphere_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match=r"--row-distance-mm 1000: .* farther apart"):
        run(tmp_path, "atlas", "--row-distance-mm", "1000")
