"""Rows of the page panel: both wheels, and the radius of the curve."""

from __future__ import annotations

from typing import Any

from diffdrive.kind import DiffDriveDescription
from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.wire.to_page import JointInfo, JointValue
from tsd_twin.lie import Array
from tsd_twin.robots import RPM

_STRAIGHT_RAD_PER_S = 0.01


class DiffDriveTelemetry:
    """Telemetry of the panel `joints`."""

    def __init__(self, robot: DiffDriveDescription) -> None:
        self._drive = robot.kinematics()

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        rows = [("left wheel", "rpm"), ("right wheel", "rpm"), ("curve radius", "m")]
        return {"panel": "joints", "joints": [JointInfo(name, unit) for name, unit in rows]}

    def state(self, joints: Array, setpoint: Array, _snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of `RobotState`."""
        wheels = [
            JointValue(round(float(now) / RPM, 1), round(float(goal) / RPM, 1))
            for now, goal in zip(joints, setpoint, strict=True)
        ]
        radii = JointValue(self._radius_m(joints), self._radius_m(setpoint))
        return {"joints": [*wheels, radii]}

    def _radius_m(self, joints: Array) -> float | None:
        """Return the radius of the curve, or None when driving straight."""
        forward, _, turn = self._drive.forward(joints).twist.tolist()
        return round(forward / turn, 2) if abs(turn) > _STRAIGHT_RAD_PER_S else None
