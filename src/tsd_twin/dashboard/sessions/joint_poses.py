"""Effect of joint values, for pages: tilt, direction and push of modules and wheels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.dashboard.wire.to_page import GimbalPose, LimitName, WheelPose
from tsd_twin.kinematics import (
    JointKind,
    Kinematics,
    OmniKinematics,
    SingularityKinematics,
    SphereKinematics,
)
from tsd_twin.lie import Array
from tsd_twin.motion import TwistLimiter
from tsd_twin.robots import RPM

_UPRIGHT_RAD = 1e-6
"""Smaller tilts have no direction."""


class GimbalDisplay:
    """Computes what pages show of the joints of a singularity drive."""

    def __init__(self, drive: SingularityKinematics) -> None:
        self.drive = drive
        # From the module frame of the kinematics to the robot's: a turn by azimuth - pi/2.
        turn = drive.azimuths_rad - np.pi / 2
        c, s = np.cos(turn), np.sin(turn)
        self._base_from_module = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)

    def axles(self, joints: Array) -> Array:
        """Return the horizontal parts (k, 2) of the unit axles in `base_link`, for joints (3k,)."""
        modules = joints.reshape(-1, 3)
        alpha, beta = modules[:, 0], modules[:, 1]
        return self._in_base(np.stack([np.cos(alpha) * np.sin(beta), np.sin(alpha)], axis=-1))

    def pushes(self, joints: Array) -> Array:
        """Return the rolling velocities (k, 2) of the pivots in `base_link`, m/s."""
        return self._in_base(self.drive.contacts(joints))

    def residuals(self, residual: Array) -> Array:
        """Return the residual (2k,) of `forward` as vectors (k, 2) in `base_link`, m/s."""
        return self._in_base(residual.reshape(-1, 2))

    def poses(self, joints: Array) -> list[GimbalPose]:
        """Return the modules for joints (3k,)."""
        limit = math.sin(self.drive.max_tilt_rad)
        axles, pushes, tilts = self.axles(joints), self.pushes(joints), self.drive.tilt(joints)
        return [
            GimbalPose(
                alpha=round(math.degrees(alpha), 2),
                beta=round(math.degrees(beta), 2),
                tilt=round(math.degrees(tilts[i]), 2),
                direction=_direction_deg(axles[i], tilts[i]),
                axle=_pair(axles[i] / limit),
                push=_pair(pushes[i]),
                rpm=round(spin / RPM),
            )
            for i, (alpha, beta, spin) in enumerate(joints.reshape(-1, 3).tolist())
        ]

    def _in_base(self, vectors: Array) -> Array:
        return (self._base_from_module @ vectors[..., None])[..., 0]


def wheel_poses(drive: OmniKinematics | SphereKinematics, joints: Array) -> list[WheelPose]:
    """Return the wheels for joints (k,)."""
    pushes = rim_velocities(drive, joints)
    return [
        WheelPose(rpm=round(speed / RPM, 1), push=_pair(pushes[i]))
        for i, speed in enumerate(joints.tolist())
    ]


def rim_velocities(drive: OmniKinematics | SphereKinematics, joints: Array) -> Array:
    """Return the rim velocities (k, 2) along the drive directions from above, m/s."""
    if isinstance(drive, SphereKinematics):
        directions = drive.actuations[:, :2]
    else:
        angles = drive.directions_rad
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return drive.wheel_radius_m * joints[:, None] * directions


def joint_share(drive: Kinematics[Any], joints: Array) -> float | None:
    """Return the fraction in use of the joint limit, sine of the tilt or speed; None if unknown."""
    if isinstance(drive, SingularityKinematics):
        return float(np.sin(drive.tilt(joints)).max() / math.sin(drive.max_tilt_rad))
    if isinstance(drive, OmniKinematics | SphereKinematics):
        return float(np.abs(joints).max() / drive.max_speed_rad_per_s)
    return None


def binding_limit(drive: Kinematics[Any], limiter: TwistLimiter, twist: Array) -> LimitName:
    """Return the limit that `twist` (3,) comes closest to, or exceeds most."""
    speed, turn, joints = limiter.utilizations(twist)
    if joints >= max(speed, turn):
        tilts = any(joint.kind is JointKind.POSITION for joint in drive.joints)
        return "tilt" if tilts else "wheel_speed"
    return "speed" if speed >= turn else "turn_rate"


def _direction_deg(axle: Array, tilt_rad: float) -> float | None:
    if tilt_rad < _UPRIGHT_RAD:
        return None
    return round(math.degrees(math.atan2(axle[1], axle[0])), 1)


def _pair(vector: Array) -> tuple[float, float]:
    x, y = vector.tolist()
    return round(x, 4) + 0.0, round(y, 4) + 0.0
