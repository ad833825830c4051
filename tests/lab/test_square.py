"""The square of the thesis: as far off as there when open, and within the figures when closed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.lab.runs import is_picture, run, table
from tsd_twin.sim import PLANTS


def figures(lines: list[str]) -> tuple[float, list[float], float]:
    """Return the time, the three errors and the largest error, per cent of the side."""
    seconds = re.search(r"in ([\d.]+) s", lines[0])
    largest = re.search(r"position ([\d.]+) %", lines[2])
    assert seconds
    assert largest
    return (
        float(seconds[1]),
        [float(n) for n in re.findall(r"\(([\d.]+) %\)", lines[1])],
        float(largest[1]),
    )


def test_open_loop_is_off_by_what_the_thesis_saw(tmp_path: Path) -> None:
    """At most 16 % there. Here by all errors of the description, which are on by default."""
    found = [figures(run(tmp_path, "square", "--seed", str(seed))) for seed in range(3)]
    found.append(figures(run(tmp_path, "square", "--plant", "mujoco")))
    assert all(seconds == 4.0 for seconds, _, _ in found)
    assert all(5.0 <= largest <= 20.0 for _, _, largest in found)
    columns = table(tmp_path / "square.csv")
    # The reference is at full speed at once, and turns corners in an instant.
    speed = np.hypot(columns["reference_vx_mps"], columns["reference_vy_mps"])
    assert set(speed[1:400].tolist()) == {1.0}
    assert is_picture(tmp_path / "square.png")
    camera = table(tmp_path / "square_camera.csv")
    assert 1.0 / np.diff(camera["t_s"]).mean() == pytest.approx(24.0, rel=0.02)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("plant", list(PLANTS))
@pytest.mark.parametrize(
    ("loop", "bounds"), [("gyro", (2.0, 2.0, 1.5)), ("camera", (1.0, 1.0, 0.5))]
)
def test_closed_loop_is_within_two_and_with_the_camera_within_one_percent(
    tmp_path: Path, loop: str, bounds: tuple[float, float, float], plant: str, seed: int
) -> None:
    """At 1 m/s and 4 m/s^2, all errors on, gyro noise, a late camera; friction 0.8 in MuJoCo."""
    lines = run(tmp_path, "square", "--loop", loop, "--seed", str(seed), "--plant", plant)
    seconds, errors, _ = figures(lines)
    assert seconds <= 5.2
    assert all(error < bound for error, bound in zip(errors, bounds, strict=True))
    columns = table(tmp_path / "square.csv")
    speed = np.hypot(columns["reference_vx_mps"], columns["reference_vy_mps"])
    assert speed.max() == pytest.approx(1.0, abs=1e-3)
    # From rest to 1 m/s in a quarter of a second.
    assert np.flatnonzero(speed > 0.999)[0] == pytest.approx(25, abs=1)


def test_the_same_seed_is_the_same_run(tmp_path: Path) -> None:
    first = run(tmp_path / "a", "square", "--loop", "camera", "--seed", "4")
    assert run(tmp_path / "b", "square", "--loop", "camera", "--seed", "4") == first
    texts = [(tmp_path / name / "square.csv").read_text() for name in ("a", "b")]
    assert texts[0] == texts[1]
