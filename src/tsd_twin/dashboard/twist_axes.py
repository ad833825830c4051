"""Twist axes of a robot (name, symbol, unit, limit), and its kinematics at the reported wheel
speed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from tsd_twin.dashboard.robot_client import Snapshot
from tsd_twin.kinematics import Kinematics
from tsd_twin.robots import RPM, RobotDescription
from tsd_twin.robots.description import Limits


class TwistAxis(NamedTuple):
    """Component of a twist: name, symbol and unit."""

    name: str
    symbol: str
    unit: str
    hint: str

    @property
    def label(self) -> str:
        """Label of its slider."""
        return f"{self.name} ({self.unit})"


FLOOR_AXES = (
    TwistAxis("vx", "vx", "m/s", "Forward is positive"),
    TwistAxis("vy", "vy", "m/s", "Left is positive"),
    TwistAxis("omega", "ω", "rad/s", "Turning left is positive"),
)
"""Of a robot that drives over a floor."""
_SPHERE_AXES = (
    TwistAxis("wx", "ωx", "rad/s", "Positive rolls the top of the sphere to the right"),
    TwistAxis("wy", "ωy", "rad/s", "Positive rolls the top of the sphere forward"),
    TwistAxis("wz", "ωz", "rad/s", "Positive turns the sphere left"),
)
_TWIST_AXES = {(0, 1, 5): FLOOR_AXES, (3, 4, 5): _SPHERE_AXES}
"""By where they stand in a spatial twist."""


def twist_axes_of(kinematics: Kinematics[Any]) -> tuple[TwistAxis, TwistAxis, TwistAxis]:
    """Return the components of a twist, in order."""
    return _TWIST_AXES[kinematics.twist_axes]


def axis_limits(kinematics: Kinematics[Any], limits: Limits) -> tuple[float, float, float]:
    """Return the limit of each component of a twist, in its unit."""
    most = limits.speed_mps / kinematics.twist_scale_m
    return most, most, limits.turn_rate_rad_per_s


def kinematics_at_reported_speed(
    robot: RobotDescription, kinematics: Kinematics[Any], snapshot: Snapshot
) -> Kinematics[Any]:
    """Return the described kinematics at the wheel speed of the newest status."""
    gears, status = robot.wheel_speed_range, snapshot.status
    if gears is None or status is None or status.wheel_speed is None:
        return kinematics
    spin = status.wheel_speed.wanted_rpm * RPM
    return kinematics if gears.refusal(spin) else gears.kinematics.with_spin(spin)
