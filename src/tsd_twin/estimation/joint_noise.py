"""How far measured joints are off, as the description says."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsd_twin.drives import Drive, JointKind
from tsd_twin.lie import Array
from tsd_twin.robots import JointErrors


class JointNoise:
    """Standard deviations of the joints of a drive: of angles, and of speeds by their share."""

    def __init__(self, drive: Drive[Any], noise: JointErrors) -> None:
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
        self._angle = is_angle * noise.angle_rad
        self._share = ~is_angle * noise.spin_share

    def sigma(self, joints: Array) -> Array:
        """Return the standard deviations (..., n) of `joints` (..., n), radians and rad/s."""
        return self._angle + self._share * np.abs(joints)
