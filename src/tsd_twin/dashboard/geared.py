"""The kinematics that a robot is driven by, in the gear that it says it has."""

from __future__ import annotations

from typing import Any

from tsd_twin.dashboard.link import Snapshot
from tsd_twin.drives import Drive
from tsd_twin.robots import RPM, Robot


def geared(robot: Robot, drive: Drive[Any], snapshot: Snapshot) -> Drive[Any]:
    """Return `drive`, the one of the description, in the gear that the newest status tells."""
    gears, status = robot.gears, snapshot.status
    if gears is None or status is None or status.gear is None:
        return drive
    spin = status.gear.wanted_rpm * RPM
    return drive if gears.refusal(spin) else gears.drive.with_spin(spin)
