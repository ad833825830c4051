"""Every omni robot stays close to four paths under PID with noise."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.support.experiment_runs import is_picture, run, table
from tsd_twin import robots
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.errors import RobotFileError, TwinError
from tsd_twin.simulation import SimRobot

PATHS = ["line", "parabola", "sine", "circle"]


def test_all_four_are_followed_within_centimetres(tmp_path: Path) -> None:
    lines = run(tmp_path, "omni-paths")
    assert [line.split(":")[0] for line in lines] == PATHS
    for line in lines:
        rms, cross, closure = (float(mm) for mm in re.findall(r"([\d.]+) mm", line))
        assert max(rms, cross, closure) < 20.0
    assert is_picture(tmp_path / "omni-paths.png")
    # The requested curves: y = x^2, and a circle with 0.5 m radius.
    columns = table(tmp_path / "omni-paths_parabola.csv")
    np.testing.assert_allclose(columns["reference_y_m"], columns["reference_x_m"] ** 2, atol=1e-5)
    assert np.abs(columns["truth_y_m"] - columns["truth_x_m"] ** 2).max() < 0.02
    columns = table(tmp_path / "omni-paths_circle.csv")
    radius = np.hypot(columns["truth_x_m"], columns["truth_y_m"] - 0.5)
    np.testing.assert_allclose(radius, 0.5, atol=0.02)
    # The heading follows the curve, all the way around.
    assert columns["truth_heading_rad"][-1] == pytest.approx(2.0 * np.pi, abs=0.05)


def test_other_kinds_are_refused_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="omni is needed here"):
        run(tmp_path, "omni-paths", "--robot", "tsd")
    atlas = robots.load_robot("atlas")
    with pytest.raises(TwinError, match="turns a sphere in place"):
        VirtualRobot(atlas, SimRobot(atlas))
