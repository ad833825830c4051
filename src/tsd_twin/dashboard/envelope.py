"""Where the robot can still get to if the link dies now, drawn on the floor."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.dashboard import palette
from tsd_twin.lie import Array

SIDES = 40
HEIGHT_M = 0.0025
_OPACITY = 0.2
_SEEN_M = 0.001
"""What changes by less is not sent again."""


def outline(path: Array, reach_m: float) -> Array:
    """Return what a disc sweeps along `path` (n, 2+), or more: a convex polygon (SIDES, 2).

    It is about the convex hull of the discs, by its support function: tangents in SIDES directions,
    and where each meets the next. The arcs to standstill are short, so the hull adds little.
    """
    angles = np.arange(SIDES) * 2.0 * np.pi / SIDES
    x, y = np.cos(angles), np.sin(angles)
    far = (path[:, :2] @ np.stack([x, y])).max(axis=0) + reach_m
    next_x, next_y, next_far = (np.roll(values, -1) for values in (x, y, far))
    corners = np.stack([far * next_y - next_far * y, next_far * x - far * next_x], axis=-1)
    return corners / np.sin(2.0 * np.pi / SIDES)


class StopEnvelope:
    """A translucent area with a rim, on the node of the robot; nothing at rest.

    While the robot moves evenly the area is the same in its frame, and nothing is sent.
    """

    def __init__(self, scene: viser.SceneApi, name: str, reach_m: float) -> None:
        self._reach_m = reach_m
        self._shown = outline(np.zeros((1, 2)), reach_m)
        self._frame = scene.add_frame(name, show_axes=False)
        fan = np.arange(1, SIDES - 1, dtype=np.uint32)
        self._area = scene.add_mesh_simple(
            f"{name}/a",
            self._raised(),
            np.stack([0 * fan, fan, fan + 1], axis=-1),
            color=palette.ENVELOPE,
            opacity=_OPACITY,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._rim = scene.add_line_segments(
            f"{name}/r",
            self._edges(),
            palette.ENVELOPE,
            thickness=2.0,
            thickness_units="screen",
            visible=False,
        )

    def update(self, path: Array | None) -> None:
        """Show where `path` (n, 3) leads, in the frame of the robot; None is nowhere."""
        self._area.visible = self._rim.visible = path is not None
        if path is None:
            return
        shape = outline(path, self._reach_m)
        if np.abs(shape - self._shown).max() < _SEEN_M:
            return
        self._shown = shape
        self._area.vertices = self._raised()
        self._rim.points = self._edges()

    def _raised(self) -> npt.NDArray[np.float32]:
        return np.insert(self._shown, 2, HEIGHT_M, axis=1).astype(np.float32)

    def _edges(self) -> npt.NDArray[np.float32]:
        corners = self._raised()
        return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
