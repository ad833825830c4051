"""Kinematics of a differential drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.kinematics import Joint, JointKind
from tsd_twin.kinematics.base import PlanarMotion, WheelKinematics
from tsd_twin.lie import Array

WHEELS = ("left_wheel", "right_wheel")
LATERAL_MPS = 1e-6
"""Sideways speed that counts as rounding."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DiffDriveKinematics(PlanarMotion, WheelKinematics):
    """Two wheels on the Y axis. A twist is forward speed and turn rate; `vy` must be zero.

    No scale makes a sideways twist possible except zero, so its `joint_utilization` is infinite:
    limits scale such a command to rest, and the robot reports that it was limited.
    """

    track_m: float
    """Distance between the wheels."""

    def __post_init__(self) -> None:
        half = 0.5 * self.track_m
        rows = np.array([[1.0, 0.0, -half], [1.0, 0.0, half]])
        self._set_wheel_matrices(rows / self.wheel_radius_m)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """`left_wheel` and `right_wheel`, in rad/s."""
        return tuple(Joint(name, JointKind.VELOCITY) for name in WHEELS)

    def joint_utilization(self, twist: Array) -> Array:
        """Speed of the faster wheel over its limit, (...); infinite for a sideways twist."""
        share = np.abs(twist @ self.speeds_from_twist.T).max(axis=-1) / self.max_speed_rad_per_s
        return np.where(np.abs(twist[..., 1]) > LATERAL_MPS, np.inf, share)
