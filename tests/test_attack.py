"""Stopping distances in `attack` are the sum of the robot's motion, and nothing else."""

from __future__ import annotations

import importlib
from collections.abc import Iterator

import numpy as np
import pytest

from attack.__main__ import PARTS, rows_of
from attack.distances import CAUSES, Result, Task, row
from attack.table import Row, summary
from attack.track import DistanceLog, Odometer
from tsd_twin import robots
from tsd_twin.lie import SE2, SO3


def test_a_way_is_counted_from_the_moment_of_the_fault_between_two_samples() -> None:
    track = DistanceLog()
    for i in range(5):
        track.add(1.0 + 0.02 * i, 0.02 * i, 1.0)
    assert track.distance_since(1.03) == pytest.approx(0.05)
    assert track.distance_since(1.0) == pytest.approx(0.08)


def test_a_robot_that_stopped_before_a_fault_was_not_fast_at_it() -> None:
    track = DistanceLog()
    for i, speed_mps in enumerate([1.0, 1.0, 0.9, 0.0]):
        track.add(0.02 * i, 0.02 * i, speed_mps)
    assert track.was_fast_at(0.03, 1.0)
    assert not track.was_fast_at(0.05, 1.0)
    assert not track.was_fast_at(9.0, 1.0)


def test_a_way_on_the_floor_is_as_long_as_it_is_whatever_the_heading() -> None:
    odometer = Odometer(robots.load_robot("kiwi").kinematics())
    for angle in np.linspace(0.0, np.pi, 500):
        pose = SE2(np.array([np.cos(angle), np.sin(angle), 7.0 * angle]))
        way_m, _ = odometer.update(pose, np.zeros(3))
    assert way_m == pytest.approx(np.pi, rel=1e-4)


def test_the_way_of_a_sphere_is_that_of_its_top() -> None:
    """A turn about Z does not move the top, but is not rest either."""
    drive = robots.load_robot("atlas").kinematics()
    odometer, pose = Odometer(drive), SO3.identity()
    for tangent in [(0.1, 0.0, 0.0)] * 3 + [(0.0, 0.0, 0.1)] * 3:
        pose = SO3.exp(np.array(tangent)) @ pose
        way_m, speed_mps = odometer.update(pose, np.array([0.0, 0.0, 1.0]))
    # The first pose is the start.
    assert way_m == pytest.approx(2 * 0.1 * drive.twist_scale_m, rel=1e-6)
    assert speed_mps > 0.0


@pytest.mark.parametrize(
    ("ways", "failure", "held"),
    [([0.9, 1.0], "", True), ([0.9, 1.01], "", False), ([0.1], "a reason", False), ([], "", False)],
)
def test_a_row_holds_when_every_run_was_measured_and_the_worst_is_within_the_promise(
    ways: list[float], failure: str, held: bool
) -> None:
    allowed_m = robots.load_robot("tsd").limits.stop_allowance_m
    result = Result("both", 1.0, [share * allowed_m for share in ways], failure)
    assert row(Task("tsd", 0.25, tuple(CAUSES), len(ways)), result).held is held


def test_the_summary_shows_the_worst_repetition_of_each_case_and_how_often_it_held() -> None:
    def moved(robot: str, way_m: float) -> tuple[str, Row]:
        return "part", Row("late", "1 m", f"{way_m} m", way_m <= 1.0, robot, way_m)

    failed = ("part", Row("late", "1 m", "not measured", False, "tsd"))
    ways = [moved("kiwi", 0.2), moved("tsd", 0.9), moved("kiwi", 0.7), moved("tsd", 1.2)]
    heading, *cells = (line.split("  ") for line in summary([*ways, failed]))
    kiwi, tsd = ([cell.strip() for cell in line if cell] for line in cells)
    assert len(heading) >= 6
    assert kiwi == ["part", "kiwi", "late", "0.7 m", "1 m", "2 of 2"]
    assert tsd == ["part", "tsd", "late", "1.2 m", "1 m", "1 of 3"]


def test_a_part_that_ends_early_leaves_a_row_that_did_not_hold(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def rows() -> Iterator[Row]:
        yield Row("first", "", "", True)
        raise TimeoutError("no robot answers")

    monkeypatch.setattr("attack.commands.rows", rows)
    first, last = rows_of("commands")
    assert first.held
    assert not last.held
    assert "no robot answers" in last.measured


@pytest.mark.parametrize("part", PARTS)
def test_every_part_can_be_loaded(part: str) -> None:
    assert callable(importlib.import_module(f"attack.{part}").rows)
