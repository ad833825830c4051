"""How servos are mounted, from a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsd_twin.hardware import HardwareError, ServoCalibration

NAMES = ["module1_alpha", "module1_beta"]


def test_joints_that_are_not_named_are_mounted_as_drawn() -> None:
    calibration = ServoCalibration()
    assert calibration.neutral(NAMES) == [2048, 2048]
    assert calibration.signs(NAMES) == [1, 1]


def test_a_file_names_joints(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('reversed = ["module1_beta"]\n[neutral_step]\nmodule1_alpha = 2100\n')
    calibration = ServoCalibration.read(str(file))
    calibration.check_joint_names(NAMES)
    assert calibration.neutral(NAMES) == [2100, 2048]
    assert calibration.signs(NAMES) == [1, -1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("neutral_step = 3", "object"),
        ("[neutral_step]\nmodule1_alpha = 4096", "4095"),
        ("nautral_step = {}", "nautral_step"),
        ("[", "cannot be used"),
    ],
)
def test_a_mistake_is_named_with_the_file(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(HardwareError, match=r"mine\.toml") as caught:
        ServoCalibration.read(str(file))
    assert words in str(caught.value)


def test_a_joint_that_is_none_is_named_with_those_there_are() -> None:
    with pytest.raises(HardwareError, match="'module9_alpha': there are module1_alpha, module1_b"):
        ServoCalibration(neutral_step={"module9_alpha": 1}).check_joint_names(NAMES)
