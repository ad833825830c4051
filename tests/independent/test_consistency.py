"""Stated covariances on independent plants, in many kinds of manoeuvres.

`python -m tests.independent` prints the whole table; these rows once failed. One in thousands of
correct estimates exceeds the limits; the seeds were not used for tuning.
"""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from tests.independent.built import Undeclared
from tests.independent.drive import GYRO, JOINTS, Row, run_row
from tsd_twin import robots


def few(robot: str, manoeuvre: str, odometry: str, **more: Any) -> Row:
    times_s = more.pop("times_s", (2.0, 5.0))
    return Row(robot, manoeuvre, odometry, robots=10, first=9700, times_s=times_s, **more)


def declared(robot: str, **errors: float) -> dict[str, Any]:
    described: Any = robots.load_robot(robot)
    return {"errors": msgspec.structs.replace(described.errors, **errors)}


@pytest.mark.parametrize(
    "row",
    [
        few("tsd", "turn and translate", GYRO),
        few("tsd", "stops", JOINTS, undeclared=Undeclared(friction=0.35)),
        few("tsd", "stops", GYRO, undeclared=Undeclared(friction=0.2)),
        few("tsd", "reversals", GYRO, undeclared=Undeclared(friction=0.2)),
        few("tsd", "creep 0.02 m/s", JOINTS),
        few("kiwi", "turn and translate", GYRO),
        few("kiwi", "figure eight", JOINTS, declared=declared("kiwi", mount_deg=0.5)),
        few("mecanum", "figure eight", JOINTS, declared=declared("mecanum", mount_deg=0.5)),
        few("omni4", "at the cap", GYRO),
        few("omni4", "reversals", JOINTS, times_s=(5.0, 20.0)),
        few("atlas", "spin", JOINTS),
        few("atlas", "wander", JOINTS, times_s=(5.0, 20.0)),
    ],
    ids=lambda row: (
        f"{row.robot} {row.manoeuvre} {row.odometry} {row.undeclared.friction or 'described'}"
    ),
)
def test_errors_are_as_large_as_the_covariance_says_on_another_plant(row: Row) -> None:
    """The mean normalized squared error of three numbers should be three."""
    for cell in run_row(row):
        assert 0.5 < cell.nees < 6.5
        assert cell.share >= 0.6


def test_a_mounting_angle_that_is_not_declared_shows() -> None:
    """Shows that the table can fail."""
    row = few("kiwi", "figure eight", JOINTS, undeclared=Undeclared(mount_deg=0.5))
    assert max(cell.nees for cell in run_row(row)) > 8.0
