"""How servos are mounted, from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tsd_twin.hardware.joints import ServoCalibration, padded_ids
from tsd_twin.hardware.serial_transport import HardwareError

NAMES = ["module1_alpha", "module1_beta"]


def test_joints_that_are_not_named_are_mounted_as_drawn() -> None:
    calibration = ServoCalibration()
    assert calibration.neutral(NAMES) == [2048, 2048]
    assert calibration.signs(NAMES) == [1, 1]
    assert calibration.ids(NAMES) == [1, 2]


def test_a_file_names_joints(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('reversed = ["module1_beta"]\n[neutral_step]\nmodule1_alpha = 2100\n')
    calibration = ServoCalibration.read(str(file))
    calibration.check_joints(NAMES)
    assert calibration.neutral(NAMES) == [2100, 2048]
    assert calibration.signs(NAMES) == [1, -1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("neutral_step = 3", "object"),
        ("[neutral_step]\nmodule1_alpha = 4096", "4095"),
        ("[servo_id]\nmodule1_alpha = 253", "252"),
        ("[servo_id]\nmodule1_alpha = 0", "1"),
        ("nautral_step = {}", "nautral_step"),
        (
            "[receiver]\ncentre_us = [1500, 1000, 1500, 1500]",
            "left: centre_us 1000 is outside its ends, 1100 to 1900: with the sticks at rest",
        ),
        ("[receiver]\nhigh_us = [1900, 1900, 1900, 1100]", "speed: low_us 1100 is not below"),
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
        ServoCalibration(neutral_step={"module9_alpha": 1}).check_joints(NAMES)
    with pytest.raises(HardwareError, match="'module9_alpha': there are module1_alpha, module1_b"):
        ServoCalibration(servo_id={"module9_alpha": 9}).check_joints(NAMES)


def test_ids_are_those_of_the_file_and_differ() -> None:
    swapped = ServoCalibration(servo_id={"module1_alpha": 2, "module1_beta": 1})
    swapped.check_joints(NAMES)
    assert swapped.ids(NAMES) == [2, 1]
    with pytest.raises(HardwareError, match="module1_alpha and module1_beta have the same id, 2"):
        ServoCalibration(servo_id={"module1_alpha": 2}).check_joints(NAMES)


def test_servos_that_the_robot_does_not_have_get_ids_of_no_other() -> None:
    random = np.random.default_rng(3)
    for count in range(1, 7):
        ids = (1 + random.permutation(252)[:count]).tolist()
        for used in (ids, list(range(1, count + 1)), list(range(6, 6 - count, -1))):
            padded = padded_ids(used)
            assert list(padded[:count]) == used
            assert len(set(padded)) == len(padded) == 6
            assert 1 <= min(padded) <= max(padded) <= 252
