"""Consistency of estimates for simulated robots with individual errors.

A few robots of each kind, and the commands of `python -m research consistency`. One in thousands of
correct estimates exceeds the limits.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from research.consistency import band
from research.open_loop import CONSTANT, DEAD_WHEELS, GYRO, JOINTS, MOUNTED, Case, run_case
from research.sphere import compare_sphere
from tests.support.experiment_runs import is_picture, run
from tsd_twin.errors import TwinError


def few(robot: str, manoeuvre: str, seeds: int = 12, errors: float = 0.0, **more: Any) -> Case:
    """A few robots for a few seconds, with other seeds than the table in the docs."""
    return Case(robot, manoeuvre, errors, seeds=seeds, first=700, times_s=(2.0, 4.0), **more)


@pytest.mark.parametrize(
    "case",
    [
        few("tsd", "straight 0.5 m/s"),
        few("tsd", "to and fro", errors=1.0),
        few("tsd", "standing", errors=1.0, odometry=GYRO),
        few("tsd", "circle", camera=MOUNTED),
        few("kiwi", "straight 0.5 m/s"),
        few("mecanum", "wander", odometry=GYRO),
        few("omni4", "wander"),
        few("omni4", "circle", odometry=DEAD_WHEELS),
    ],
    ids=lambda case: f"{case.robot} {case.manoeuvre} {case.sensors}",
)
def test_errors_are_as_large_as_the_covariance_says(case: Case) -> None:
    """The mean normalized squared error of three numbers should be three."""
    result = run_case(case)
    assert (result.means > 0.8).all()
    assert (result.means < 6.5).all()
    assert result.coverage.mean() > 0.6
    assert result.heading_coverage.mean() > 0.6


@pytest.mark.parametrize(
    ("manoeuvre", "times_s"),
    [("straight 1 m/s", (1.0, 2.0)), ("drive speeds", (3.0,))],
    ids=["start", "drive speeds"],
)
def test_rigid_bodies_slide_no_further_than_the_covariance_says(
    manoeuvre: str, times_s: tuple[float, ...]
) -> None:
    """On MuJoCo: after a start, and after wheels sped up, which turns the robot."""
    case = Case("tsd", manoeuvre, plant="mujoco", seeds=5, first=700, times_s=times_s)
    result = run_case(case)
    assert (result.means > 1.0).all()
    assert (result.means < 7.0).all()
    assert result.coverage.mean() > 0.6
    assert result.heading_coverage.mean() > 0.6


@pytest.mark.parametrize(("odometry", "friction"), [(JOINTS, 0.35), (GYRO, 0.2), (GYRO, 0.35)])
def test_braking_on_a_slippery_floor_slides_no_further_than_the_covariance_says(
    odometry: str, friction: float
) -> None:
    """A floor that transmits 2.0 or 3.4 m/s², starts at 4 m/s² and stops at 6 m/s²."""
    case = Case("tsd", "stops", 1.0, odometry, plant="mujoco", seeds=10, first=700, times_s=(5.0,))
    result = run_case(replace(case, friction=friction))
    assert (result.means > 1.0).all()
    assert (result.means < 5.5).all()


def test_a_camera_that_is_2_cm_off_is_within_what_is_claimed() -> None:
    result = run_case(few("tsd", "standing", seeds=3, camera=CONSTANT))
    assert (result.means < 10.0).all()


def test_the_band_is_that_of_the_chi_square() -> None:
    """Against random draws."""
    means = np.random.default_rng(0).chisquare(3, (20_000, 40)).mean(axis=1)
    np.testing.assert_allclose(band(40), np.quantile(means, [0.025, 0.975]), rtol=0.02)


def test_the_experiment_prints_a_cell_for_each_case_and_writes_the_table(tmp_path: Path) -> None:
    flags = ["--robots", "mecanum", "--manoeuvres", "circle", "--seeds", "2", "--jobs", "1"]
    lines = run(tmp_path, "consistency", *flags)
    head, *rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("|")]
    sensors = ["joints", "camera, mounted", "gyro", "gyro + camera, mounted", "camera, 2 cm off"]
    assert head == ["errors", "manoeuvre", *sensors]
    nees, shares = (row for row in rows if row[:2] == ["0", "circle"])
    assert [len(cell.split(" / ")) for cell in nees[2:]] == 5 * [3]
    assert all(cell.count(" %") == 2 for cell in shares[2:])
    assert is_picture(tmp_path / "consistency.png")
    head, *written = (tmp_path / "consistency.csv").read_text().splitlines()
    assert "nees_20_s" in head.split(",")
    assert len(written) == 5
    means = [float(text) for cell in nees[2:] for text in cell.split(" / ")]
    assert f"smallest NEES {min(means):.1f}: mecanum" in lines[-1]
    assert f"largest NEES {max(means):.1f}: mecanum" in lines[-1]
    lines = run(tmp_path, "consistency", *flags, "--sensors", "joints")
    assert "| errors | manoeuvre | joints |" in lines


@pytest.mark.parametrize(
    ("flags", "text"),
    [
        (["--robots", "atlas", "--manoeuvres", "circle"], "atlas has no manoeuvre 'circle'"),
        (["--manoeuvres", "fly"], "no manoeuvre 'fly'"),
        (["--robots", "kiwi", "--sensors", "dead wheels"], "the sensors 'dead wheels': joints"),
        (["--robots", "tsd", "--friction", "0.35"], "tsd has no friction on this plant"),
    ],
)
def test_what_cannot_be_driven_is_refused(tmp_path: Path, flags: list[str], text: str) -> None:
    with pytest.raises(TwinError, match=text):
        run(tmp_path, "consistency", *flags)


def test_spheres_have_rows() -> None:
    case = Case("atlas", "roll", odometry="joints", seeds=8, first=7100, times_s=(1.0, 2.0))
    found = compare_sphere(case)
    assert found.nees.shape == (2, 8)
    assert ((found.means > 0.7) & (found.means < 8.0)).all()
    assert found.coverage.min() > 0.3
