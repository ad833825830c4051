"""Where the robot was."""

from __future__ import annotations

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.rate import Rate
from tsd_twin.lie import Array

SPACING_M = 0.02
CHUNK = 64
CHUNKS = 32
"""As many chunks of as many segments as are kept: the last 40 m."""
JUMP_M = 0.5
"""A step this long is no motion: the pose was set."""
HEIGHT_M = 0.002


class Trail:
    """The path of the estimate, in chunks: only the newest one is sent again as it grows."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._scene = scene
        self._name = name
        self._nodes: dict[int, viser.LineSegmentsHandle] = {}
        self._chunk = 0
        self._segments: list[tuple[Array, Array]] = []
        self._last: Array | None = None
        self._sent = 0
        self._rate = Rate(5.0)

    def update(self, xy: Array, now_s: float) -> None:
        """Take in where the robot is, (2,)."""
        here = np.array([xy[0], xy[1], HEIGHT_M])
        step_m = np.inf if self._last is None else float(np.linalg.norm(here - self._last))
        if step_m >= SPACING_M:
            if self._last is not None and step_m < JUMP_M:
                self._segments.append((self._last, here))
            self._last = here
        full = len(self._segments) >= CHUNK
        if len(self._segments) > self._sent and (self._rate.due(now_s) or full):
            self._send()
        if full:
            self._chunk = (self._chunk + 1) % CHUNKS
            self._segments, self._sent = [], 0

    def clear(self) -> None:
        """Forget the path."""
        for node in self._nodes.values():
            node.remove()
        self._nodes.clear()
        self._segments, self._sent, self._chunk = [], 0, 0

    def _send(self) -> None:
        points = np.array(self._segments, np.float32)
        self._sent = len(points)
        if self._chunk in self._nodes:
            self._nodes[self._chunk].points = points
        else:
            self._nodes[self._chunk] = self._scene.add_line_segments(
                f"{self._name}/{self._chunk}",
                points,
                palette.ESTIMATE,
                thickness=2.5,
                thickness_units="screen",
            )
