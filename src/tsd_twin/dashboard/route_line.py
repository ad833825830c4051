"""Where a robot is planned to go, on the floor."""

from __future__ import annotations

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.lie import SE2, Array

HEIGHT_M = 0.003
POINTS = 120
"""Of the line; a robot cannot bend it more than these show."""
_SIDES = 32
_TIP_M = 0.06


def lines(poses: Array, reach_m: float) -> Array:
    """Return the segments (k, 2, 3) of a way through `poses` (n, 3), n above 1.

    At its end stands a ring as large as the robot, with a tip where it will look.
    """
    way = np.stack([poses[:-1, :2], poses[1:, :2]], axis=1)
    around = np.arange(_SIDES) * 2.0 * np.pi / _SIDES
    ring = reach_m * np.stack([np.cos(around), np.sin(around)], axis=-1)
    tip = np.array([[reach_m, 0.5 * _TIP_M], [reach_m + _TIP_M, 0.0], [reach_m, -0.5 * _TIP_M]])
    end = SE2(poses[-1])
    marks = np.concatenate(
        [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1), np.stack([tip[:-1], tip[1:]], axis=1)]
    )
    placed = end.rotate(marks) + poses[-1, :2]
    flat = np.concatenate([way, placed])
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), HEIGHT_M)], axis=-1)


class RouteLine:
    """One node, which is there while there is a way."""

    def __init__(self, scene: viser.SceneApi, name: str, reach_m: float) -> None:
        self._scene = scene
        self._name = name
        self._reach_m = reach_m
        self._node: viser.LineSegmentsHandle | None = None

    def update(self, poses: Array | None) -> None:
        """Show a way through `poses` (n, 3); None is nowhere."""
        if self._node is not None:
            self._node.remove()
            self._node = None
        if poses is not None:
            self._node = self._scene.add_line_segments(
                self._name,
                lines(poses, self._reach_m).astype(np.float32),
                palette.ROUTE,
                thickness=4.0,
                thickness_units="screen",
            )
