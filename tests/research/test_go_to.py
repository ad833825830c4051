"""Driving to a goal over a delayed link: the robot arrives without overshoot.

Some goals of `python -m research go-to`, with other seeds than the table in the docs.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from research.go_to import Case, go
from tests.support.experiment_runs import is_picture, run

OVERSHOOT_M = 0.01


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("unknown_s", [0.0, 0.2])
def test_it_arrives_and_overshoots_by_less_than_10_mm(delay_s: float, unknown_s: float) -> None:
    for seed in (200, 201):
        arrival = go(Case("tsd", delay_s + unknown_s, delay_s), seed)
        assert arrival.has_arrived, arrival.reason
        assert arrival.overshoot_m < OVERSHOOT_M


def test_a_delay_that_is_neither_known_nor_measured_leads_far_beyond() -> None:
    """Shows that the test above can fail."""
    arrival = go(Case("tsd", 0.3, 0.1, is_measured=False), 200)
    assert arrival.overshoot_m > 0.05


def test_pose_sensor_brings_the_true_position_to_the_goal() -> None:
    """Without a sensor, only the estimate reaches the goal."""
    blind, watched = (
        [go(Case("tsd", 0.1, 0.1, errors=1.0, has_camera=camera), seed) for seed in (200, 201, 203)]
        for camera in (False, True)
    )
    assert max(each.off_by_estimate_m for each in [*blind, *watched]) < 0.03
    assert max(each.off_m for each in watched) < 0.03
    assert max(each.off_m for each in blind) > 0.05


def test_the_experiment_prints_a_row_for_each_delay_and_writes_the_table(tmp_path: Path) -> None:
    lines = run(tmp_path, "go-to", "--seeds", "1", "--jobs", "1")
    rows = [line.split("|") for line in lines if line.startswith("| ") and line[2].isdigit()]
    assert [row[1].strip() for row in rows] == [
        "0",
        "100",
        "300",
        "200",
        "300",
        "500",
        *["300"] * 3,
    ]
    assert is_picture(tmp_path / "go_to.png")
    assert len((tmp_path / "go_to.csv").read_text().splitlines()) == 10
