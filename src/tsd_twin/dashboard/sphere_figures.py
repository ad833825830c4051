"""What a page is told about a sphere that wheels turn in place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.dashboard.link import Snapshot
from tsd_twin.dashboard.protocol import Apart, Ball, Triple
from tsd_twin.dashboard.wheel_figures import wheels
from tsd_twin.lie import SO3, Array
from tsd_twin.messages.ros import Odometry
from tsd_twin.robots import RPM, SphereRobot

_SLOW_RAD_PER_S = 0.02
"""Below this, directions of two angular velocities say nothing."""


class SphereFigures:
    """Wheels, orientation, and what the two models of the contacts make of the same wheels."""

    def __init__(self, robot: SphereRobot) -> None:
        self._drive = robot.kinematics()
        self._dual_first = robot.estimate.model == "dual"

    def card(self) -> dict[str, Any]:
        """Return what belongs into a card."""
        return {
            "panel": "sphere",
            "wheels": self._drive.actuators,
            "max_rpm": round(self._drive.max_speed_rad_per_s / RPM, 1),
            "other": "ideal model" if self._dual_first else "dual-row model",
        }

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot) -> dict[str, Any]:
        """Return what belongs into a state."""
        return {
            "wheels": wheels(self._drive, joints, setpoint),
            "ball": self._ball(snapshot, joints),
            "apart": _apart(snapshot),
        }

    def _ball(self, snapshot: Snapshot, joints: Array) -> Ball | None:
        odom, other = snapshot.odom, snapshot.other
        if odom is None or odom.wxyz is None:
            return None
        dual = odom if self._dual_first else other
        ideal = self._drive.forward(joints).twist
        w, x, y, z = (round(float(part), 5) for part in odom.wxyz)
        return Ball(
            wxyz=(w, x, y, z),
            ideal=_triple(ideal),
            dual=None if dual is None else _triple(dual.twist),
            angle_deg=None if dual is None else _angle_deg(ideal, dual.twist),
            magnitude_percent=None if dual is None else _magnitude_percent(ideal, dual.twist),
            rows=self._rows(joints, dual),
        )

    def _rows(self, joints: Array, dual: Odometry | None) -> list[int]:
        """Return which row each wheel stands on, 1 or 2; 0 when its motion does not tell.

        A wheel's speed is (R / r) (cos Omega_i + side sin R_i) . w: what is not explained by the
        ideal contact is the side, -1 on the first row.
        """
        drive = self._drive
        if dual is None or drive.row_offset_rad == 0.0:
            return [0] * drive.wheels
        scaled = joints * drive.wheel_radius_m / drive.sphere_radius_m
        rest = scaled - math.cos(drive.row_offset_rad) * (drive.axes @ dual.twist)
        lever = math.sin(drive.row_offset_rad) * (drive.contacts @ dual.twist)
        clear = np.abs(lever) > math.sin(drive.row_offset_rad) * _SLOW_RAD_PER_S
        side = np.where(clear, rest / np.where(clear, lever, 1.0), 0.0)
        return [0 if abs(one) < 0.5 else (1 if one < 0.0 else 2) for one in side]


def _apart(snapshot: Snapshot) -> Apart | None:
    """Return how far the sphere is turned by the other estimate, against the estimate."""
    odom, other = snapshot.odom, snapshot.other
    if odom is None or other is None or odom.wxyz is None or other.wxyz is None:
        return None
    between = SO3(odom.wxyz).inverse() @ SO3(other.wxyz)
    return Apart(metres=0.0, degrees=round(float(np.degrees(np.linalg.norm(between.log()))), 2))


def _angle_deg(a: Array, b: Array) -> float | None:
    """Return the angle between two angular velocities; None when one is too slow to tell."""
    lengths = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(lengths) < _SLOW_RAD_PER_S:
        return None
    return round(math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))), 2)


def _magnitude_percent(ideal: Array, dual: Array) -> float | None:
    """Return 1 - |ideal| / |dual| in percent, as in Fig. 7 of the paper."""
    length = float(np.linalg.norm(dual))
    if length < _SLOW_RAD_PER_S:
        return None
    return round(100.0 * (1.0 - float(np.linalg.norm(ideal)) / length), 2)


def _triple(values: Array) -> Triple:
    a, b, c = (round(float(value), 5) for value in values)
    return a, b, c
