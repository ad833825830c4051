"""What the wheels do over the ground: an arrow at each contact."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.poses import Skeleton
from tsd_twin.dashboard.rate import Rate
from tsd_twin.lie import Array

LENGTH_PER_SPEED_S = 0.25
"""Metres of arrow for a metre a second."""
SLOWEST_MPS = 0.02
HEAD_M = 0.028
HEIGHT_M = 0.006


class ThrustArrows:
    """What each wheel gives the robot, or the ball on it: direction and speed, by the joints."""

    def __init__(self, scene: viser.SceneApi, name: str, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        wheels = sum(limbs.count for limbs in skeleton.wheels)
        self._rate = Rate(12.0)
        self._drawn = np.zeros((wheels, 3))
        self._handle = scene.add_arrows(
            name,
            np.zeros((wheels, 2, 3)),
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
        places, velocities = self._skeleton.contacts(joints)
        speeds = np.linalg.norm(velocities, axis=-1)
        velocities[speeds < SLOWEST_MPS] = 0.0
        if np.abs(velocities - self._drawn).max() < 0.5 * SLOWEST_MPS:
            return
        self._drawn = velocities
        fast = speeds >= SLOWEST_MPS
        self._handle.visible = bool(fast.any())
        if fast.any():
            self._handle.points = arrows(places[fast], velocities[fast], speeds[fast])


def arrows(starts: Array, velocities: Array, speeds: Array) -> npt.NDArray[np.float32]:
    """Return arrows (n, 2, 3) from `starts` (n, 3), just above what they lie on."""
    lifted = starts + np.array([0.0, 0.0, HEIGHT_M])
    # The head comes on top, so that the slowest arrow is no shorter than it.
    ends = lifted + velocities * (LENGTH_PER_SPEED_S + HEAD_M / speeds)[:, None]
    return np.stack([lifted, ends], axis=1).astype(np.float32)
