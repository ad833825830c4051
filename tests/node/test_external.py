"""A program without any project code drives the robot by the table of keys."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.node.external_driver import PERIOD_S
from tests.support.robot_node import running
from tests.support.withheld import WithheldTime
from tsd_twin import robots

DRIVER = Path(__file__).with_name("external_driver.py")


@pytest.fixture(scope="module")
def drive() -> dict[str, Any]:
    """Run the program against the `tsd` robot, and return its output.

    Each figure includes the CPU time withheld from both processes.
    """
    command = [sys.executable, "-I", str(DRIVER)]
    lines: list[dict[str, Any]] = []
    with (
        running(toml=robots.read_description("tsd")) as node,
        subprocess.Popen([*command, node.endpoint, node.id], stdout=subprocess.PIPE) as process,
    ):
        assert process.stdout is not None
        withheld = WithheldTime(os.getpid())
        for line in process.stdout:
            lines.append(json.loads(line) | {"withheld_s": withheld.total_s})
            withheld = WithheldTime(os.getpid())
        assert process.wait(90) == 0
    return {line.get("figure", "end"): line for line in lines}


@pytest.mark.system
@pytest.mark.parametrize("figure", ["straight", "strafe", "turn", "circle", "eight"])
def test_the_estimate_follows_the_truth_within_a_hundredth_of_the_path(
    drive: dict[str, Any], figure: str
) -> None:
    """While the processor is withheld from the loop, joints move unmeasured."""
    result = drive[figure]
    # A turn on the spot has almost no path length, so use the arc of a wheel.
    path_m = result["path_m"] + 0.15 * result["turned_rad"]
    allowed_m = 0.01 * path_m + 0.3 * result["withheld_s"]
    assert path_m > 0.2
    assert result["worst_m"] <= allowed_m
    assert 0.15 * result["worst_rad"] <= allowed_m


@pytest.mark.system
@pytest.mark.parametrize(
    ("figure", "path_m", "end"),
    [
        ("straight", 0.7, (0.7, 0.0, 0.0)),
        ("strafe", 0.6, (0.0, 0.6, 0.0)),
        ("turn", 0.0, (0.0, 0.0, 1.8)),
        ("circle", 1.5, (0.0, 0.0, 0.0)),
        ("eight", 3.0, (0.0, 0.0, 0.0)),
    ],
)
def test_the_figures_are_what_they_are_called(
    drive: dict[str, Any], figure: str, path_m: float, end: tuple[float, float, float]
) -> None:
    """Up to the delay of noticing the end of a figure, plus braking."""
    result = drive[figure]
    late_s = 0.25 + result["withheld_s"]
    assert path_m - 0.01 <= result["path_m"] <= path_m + 0.7 * late_s
    assert np.hypot(*np.subtract(result["end"], end)[:2]) < 0.7 * late_s
    heading = result["end"][2] - end[2]
    assert abs(np.remainder(heading + np.pi, 2 * np.pi) - np.pi) < 2.5 * late_s


@pytest.mark.system
def test_it_needed_nothing_of_ours_and_all_its_commands_counted(drive: dict[str, Any]) -> None:
    assert drive["end"]["leases"] == 1
    withheld_s = sum(figure["withheld_s"] for figure in drive.values())
    dropped: dict[str, int] = dict(drive["end"]["dropped"])
    # Commands are dropped only if delayed beyond their maximum age.
    assert dropped.pop("stale") <= withheld_s / PERIOD_S
    assert not any(dropped.values()), drive["end"]
    assert drive["end"]["ours"] == []
