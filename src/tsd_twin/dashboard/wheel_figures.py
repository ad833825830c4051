"""What a page is told about wheels that roll."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.dashboard.link import Snapshot
from tsd_twin.dashboard.protocol import Apart, Wheel
from tsd_twin.drives import OmniDrive, SphereDrive
from tsd_twin.lie import Array, wrap
from tsd_twin.robots import RPM, OmniRobot


class WheelFigures:
    """Speed of each wheel, as it is and as it should be, and what no motion explains of it."""

    def __init__(self, robot: OmniRobot) -> None:
        self._drive = robot.kinematics()
        self._trackers = robot.dead_wheels is not None

    def card(self) -> dict[str, Any]:
        """Return what belongs into a card."""
        return {
            "panel": "wheels",
            "wheels": self._drive.actuators,
            "max_rpm": round(self._drive.max_speed_rad_per_s / RPM, 1),
            "other": "driven wheels" if self._trackers else None,
        }

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot) -> dict[str, Any]:
        """Return what belongs into a state."""
        return {"wheels": wheels(self._drive, joints, setpoint), "apart": _apart(snapshot)}


def wheels(drive: OmniDrive | SphereDrive, joints: Array, setpoint: Array) -> list[Wheel]:
    """Return the figures of all wheels, from the joint vectors (k,)."""
    residual = drive.forward(joints).residual
    return [
        Wheel(
            rpm=round(float(joints[i]) / RPM, 1),
            set_rpm=round(float(setpoint[i]) / RPM, 1),
            residual_mps=round(float(residual[i]), 4),
        )
        for i in range(len(joints))
    ]


def _apart(snapshot: Snapshot) -> Apart | None:
    """Return how far the other estimate is from the estimate."""
    if snapshot.odom is None or snapshot.other is None:
        return None
    off = snapshot.other.xy_heading - snapshot.odom.xy_heading
    return Apart(
        metres=round(math.hypot(off[0], off[1]), 4),
        degrees=round(abs(float(np.degrees(wrap(off[2])))), 2),
    )
