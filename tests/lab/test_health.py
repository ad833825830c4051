"""A shadow twin names the worn parts of robots, and none on sound robots.

The seeds differ from those used for tuning and for the table in the docs.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.experiment_runs import run
from tests.support.recorded_drives import RecordedDrive
from tsd_twin.errors import TwinError
from tsd_twin.lab.wear_drives import WearScenario, drive
from tsd_twin.recording.mcap_file import RecordingFile

WITHIN_S = 5.0
WHEEL_S = 9.0
"""Wheel faults show only in motion; a test that knows size and onset needs as long."""


@pytest.mark.parametrize(
    ("robot", "plant", "errors", "camera", "wear"),
    [
        ("tsd", "kinematic", 0.0, False, "module2_alpha=-30%"),
        ("tsd", "kinematic", 1.0, False, "module1_beta=-30%"),
        ("tsd", "mujoco", 1.0, False, "module3_alpha=-30%"),
        ("tsd", "kinematic", 1.0, True, "module3_wheel=-10%"),
        ("tsd", "mujoco", 1.0, True, "module1_wheel=-10%"),
        ("tsd", "kinematic", 1.0, False, "battery=-1V"),
        ("kiwi", "kinematic", 0.0, False, "wheel2=-5%"),
        ("omni4", "kinematic", 0.0, False, "wheel3=-5%"),
        ("atlas", "kinematic", 0.0, False, "wheel2=-5%"),
    ],
)
def test_a_worn_part_is_named_in_time_and_no_other(
    robot: str, plant: str, errors: float, camera: bool, wear: str
) -> None:
    # Smooth motions reveal wheels; starts and stops reveal servos.
    is_wheel = "wheel" in wear
    manoeuvre = "wander" if is_wheel else "full stick"
    seconds = 8.0 + WHEEL_S if is_wheel else 13.0
    case = WearScenario(robot, plant, errors, 800, manoeuvre, seconds, camera, wear, 8.0)
    result = drive(case)
    assert result.found_s <= (WHEEL_S if is_wheel else WITHIN_S), result.named
    assert result.wrong == [], result.named


@pytest.mark.parametrize(
    ("robot", "wear"),
    [
        ("tsd", "module2_wheel=-5%"),
        ("kiwi", "wheel2=-5%"),
        ("mecanum", "wheel1=-5%"),
        ("omni4", "wheel3=-5%"),
        ("atlas", "wheel2=-5%"),
    ],
)
def test_no_other_part_is_named_in_the_busiest_motion(robot: str, wear: str) -> None:
    result = drive(
        WearScenario(robot, "kinematic", 0.0, 800, "full stick", 20.0, robot == "tsd", wear, 8.0)
    )
    assert result.wrong == [], result.named


def test_one_direction_does_not_tell_which_part_it_is() -> None:
    """On an arc a slow wheel, its neighbour and a slipped gimbal all explain the motion."""
    result = drive(
        WearScenario("tsd", "kinematic", 0.0, 800, "arc", 20.0, True, "module2_wheel=-5%", 8.0)
    )
    assert [drift.part for _, drift in result.named] == [""]


def test_a_slow_servo_is_told_from_the_lean_of_a_robot_that_slides() -> None:
    # Servos yield later than the simulated robot accelerates, which must not count as a fault.
    result = drive(
        WearScenario("tsd", "mujoco", 0.0, 825, "full stick", 13.0, False, "module2_beta=-30%", 8.0)
    )
    assert result.found_s <= WITHIN_S, result.named
    assert result.wrong == [], result.named


@pytest.mark.parametrize(
    ("plant", "errors", "manoeuvre"),
    [
        ("kinematic", 1.0, "wander"),
        ("mujoco", 0.0, "straight 1 m/s"),
        ("mujoco", 1.0, "full stick"),
        ("mujoco", 1.0, "arc"),
    ],
)
def test_nothing_is_named_of_a_sound_robot(plant: str, errors: float, manoeuvre: str) -> None:
    result = drive(WearScenario("tsd", plant, errors, 810, manoeuvre, 12.0, camera=True))
    assert result.named == []
    assert result.compared_s > 11.0


def test_a_recording_says_the_same(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "run.mcap")
    robot = RecordedDrive(file)
    pilot = robot.get_ready()
    for i in range(6):
        robot.drive(pilot, (0.4 * (i % 2), 0.1, 0.0), 0.5)
    file.close()
    lines = run(tmp_path, "health", "--log", str(tmp_path / "run.mcap"))
    assert len([line for line in lines if line.startswith("| module")]) == 9
    assert "OUTSIDE" not in "".join(lines)
    assert "no part drifts" in lines
    assert any("heading" in line for line in lines)


def test_the_experiment_prints_a_row_for_each_kind_of_robot(tmp_path: Path) -> None:
    flags = ["--seconds", "5", "--errors", "0", "--jobs", "1"]
    lines = run(tmp_path, "health", "--robot", "kiwi", *flags)
    row = "| kinematic | 0 | joints | none | mixed | 1 |"
    assert len([line for line in lines if line.startswith(row)]) == 1
    assert "found_after_s,wrong_names" in (tmp_path / "health.csv").read_text()


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--wear", "wheel2=-5%"], "no joint of tsd"),
        (["--log", "nope.mcap"], "nope.mcap"),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path: Path, flags: list[str], words: str) -> None:
    with pytest.raises(TwinError, match=words):
        run(tmp_path, "health", *flags)
