"""What the wheels do over the ground: an arrow at each contact."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.poses import contact_velocities
from tsd_twin.dashboard.rate import Rate
from tsd_twin.drives import SingularityDrive
from tsd_twin.lie import Array

LENGTH_PER_SPEED_S = 0.25
"""Metres of arrow for a metre a second."""
SLOWEST_MPS = 0.02
HEAD_M = 0.028
HEIGHT_M = 0.006


class ThrustArrows:
    """Direction and size of the velocity that each wheel gives the robot, by its measured tilt."""

    def __init__(self, scene: viser.SceneApi, name: str, drive: SingularityDrive) -> None:
        self._drive = drive
        self._rate = Rate(12.0)
        self._drawn = np.zeros((drive.modules, 2))
        self._handle = scene.add_arrows(
            name,
            np.zeros((drive.modules, 2, 3)),
            palette.THRUST,
            shaft_radius=0.004,
            head_radius=0.011,
            head_length=HEAD_M,
            visible=False,
        )

    def update(self, joints: Array, now_s: float) -> None:
        """Show what joint vector (n,) does."""
        if not self._rate.due(now_s):
            return
        velocities = contact_velocities(self._drive, joints)
        speeds = np.hypot(*velocities.T)
        velocities[speeds < SLOWEST_MPS] = 0.0
        if np.abs(velocities - self._drawn).max() < 0.5 * SLOWEST_MPS:
            return
        self._drawn = velocities
        fast = speeds >= SLOWEST_MPS
        self._handle.visible = bool(fast.any())
        if fast.any():
            self._handle.points = _arrows(
                self._drive.pivots_m[fast], velocities[fast], speeds[fast]
            )


def _arrows(starts: Array, velocities: Array, speeds: Array) -> npt.NDArray[np.float32]:
    """Return arrows (n, 2, 3) on the floor from `starts` (n, 2)."""
    points = np.full((len(starts), 2, 3), HEIGHT_M, np.float32)
    points[:, 0, :2] = starts
    # The head comes on top, so that the slowest arrow is no shorter than it.
    points[:, 1, :2] = starts + velocities * (LENGTH_PER_SPEED_S + HEAD_M / speeds)[:, None]
    return points
