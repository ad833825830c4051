"""False alarms and detections of the consistency monitor, on both plants.

Few robots, with other seeds than the table in the docs.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from research.alarms import Case, detection, false_alarms
from tests.support.experiment_runs import is_picture, run
from tsd_twin.errors import TwinError


@pytest.mark.parametrize(
    ("plant", "manoeuvre"), [("kinematic", "straight 1 m/s"), ("mujoco", "full stick")]
)
def test_a_sound_robot_with_all_its_errors_raises_no_alarm(plant: str, manoeuvre: str) -> None:
    result = false_alarms(Case("tsd", plant, 1.0, seeds=1, first=700), manoeuvre, 5.0)
    assert len(result.levels) == 100
    assert result.alarms == 0


@pytest.mark.parametrize(("plant", "offset_deg"), [("kinematic", 0.33), ("mujoco", 1.0)])
def test_a_gimbal_that_is_aside_is_named(plant: str, offset_deg: float) -> None:
    result = detection(Case("tsd", plant, 0.0, seeds=1, first=700), offset_deg, trials=2)
    assert result.named.all()


def test_the_experiment_prints_a_row_for_each_case(tmp_path: Path) -> None:
    flags = ["--seeds", "1", "--seconds", "1", "--trials", "1", "--offsets-deg", "1"]
    lines = run(tmp_path, "alarms", *flags, "--jobs", "1")
    assert len([line for line in lines if line.startswith("| kinematic")]) == 8
    assert is_picture(tmp_path / "false_alarms.png")
    assert "statuses,alarms,largest_level" in (tmp_path / "false_alarms.csv").read_text()
    assert "found,right_module" in (tmp_path / "offsets_found.csv").read_text()


def test_a_robot_without_gimbals_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="no gimbals"):
        run(tmp_path, "alarms", "--robot", "kiwi")
