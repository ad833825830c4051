"""Paths on the floor: the trail behind a robot, and the planned path ahead with its goal."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.dashboard.scene.appearance import Palette
from tsd_twin.dashboard.scene.themed import RateLimiter, add_area, add_lines, dashes, raised, themed
from tsd_twin.dashboard.scene.unlit import mixed, vertex_colour
from tsd_twin.lie import SE2, Array

TRAIL_SPACING_M = 0.02
TRAIL_CHUNK = 64
TRAIL_CHUNKS = 32
"""Number of chunks kept, each with TRAIL_CHUNK segments: the last 40 m."""
TRAIL_JUMP_M = 0.5
"""A longer step is not motion but a change of the pose."""
TRAIL_HEIGHT_M, TRAIL_WIDTH_M = 0.0025, 0.008
_FADING_CHUNKS = 5
"""Number of chunks along which the trail fades."""
_OLDEST_SHARE = 0.25
"""Strength of the oldest part of the trail."""


def trail_shares(ages: Array) -> Array:
    """Return the strengths of the trail at ages (n,), in chunks before the latest end."""
    return np.maximum(_OLDEST_SHARE, 1.0 - np.asarray(ages) / _FADING_CHUNKS)


class Trail:
    """Path of the estimate, in chunks; only the latest chunk is resent as it grows.

    It fades with the number of later chunks, so that older chunks are recoloured once per chunk.
    """

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._scene = scene
        self._themes = themed(scene, name)
        self._nodes: dict[int, list[viser.LineSegmentsHandle]] = {}
        self._chunk = 0
        self._segments: list[tuple[Array, Array]] = []
        self._last: Array | None = None
        self._sent = 0
        self._rate = RateLimiter(5.0)

    def update(self, xy: Array, now_s: float) -> None:
        """Append a position (2,)."""
        here = np.array([xy[0], xy[1], TRAIL_HEIGHT_M])
        step_m = np.inf if self._last is None else float(np.linalg.norm(here - self._last))
        if step_m >= TRAIL_SPACING_M:
            if self._last is not None and step_m < TRAIL_JUMP_M:
                self._segments.append((self._last, here))
            self._last = here
        full = len(self._segments) >= TRAIL_CHUNK
        if len(self._segments) > self._sent and (self._rate.is_due(now_s) or full):
            self._send()
        if full:
            self._fade()
            self._chunk = (self._chunk + 1) % TRAIL_CHUNKS
            self._segments, self._sent = [], 0

    def clear(self) -> None:
        """Clear the path."""
        for nodes in self._nodes.values():
            for node in nodes:
                node.remove()
        self._nodes.clear()
        self._segments, self._sent, self._chunk = [], 0, 0

    def _send(self) -> None:
        points = np.array(self._segments, np.float32)
        self._sent = len(points)
        new = self._chunk not in self._nodes
        for number, (node, palette) in enumerate(self._themes):
            colours = self._colours(palette, len(points), 0)
            if new:
                name = f"{node}/{self._chunk}"
                lines = add_lines(self._scene, name, points, colours, TRAIL_WIDTH_M)
                self._nodes.setdefault(self._chunk, []).append(lines)
            else:
                lines = self._nodes[self._chunk][number]
                lines.points, lines.colors = points, colours

    def _fade(self) -> None:
        """Recolour the latest chunks before another one follows."""
        for age in range(_FADING_CHUNKS + 1):
            nodes = self._nodes.get((self._chunk - age) % TRAIL_CHUNKS)
            if nodes is not None:
                for lines, (_, palette) in zip(nodes, self._themes, strict=True):
                    lines.colors = self._colours(palette, len(lines.points), age + 1)

    @staticmethod
    def _colours(palette: Palette, segments: int, later: int) -> npt.NDArray[np.uint8]:
        """Return the colours (n, 2, 3) of a chunk that so many others follow."""
        ages = later + 1.0 - np.arange(segments + 1) / TRAIL_CHUNK
        shades = [
            vertex_colour(mixed(palette.estimate, palette.floor, float(share)))
            for share in trail_shares(ages)
        ]
        ends = np.array(shades, np.uint8)
        return np.stack([ends[:-1], ends[1:]], axis=1)


ROUTE_HEIGHT_M = 0.003
ROUTE_POINTS = 120
"""Number of points of the line, enough for the strongest curvature of a robot."""
_ROUTE_WIDTH_M, _ROUTE_DASH_M, _ROUTE_GAP_M = 0.007, 0.05, 0.028
_GOAL_OPACITY = 0.3
_GOAL_TIP_M = 0.06


def goal_lines(outline: Array, pose: Array) -> Array:
    """Return segments (k, 2, 2) of an outline (n, 2) with a heading handle at a pose (3,)."""
    nose = float(outline[:, 0].max())
    tip = np.array(
        [[nose, 0.5 * _GOAL_TIP_M], [nose + _GOAL_TIP_M, 0.0], [nose, -0.5 * _GOAL_TIP_M]]
    )
    sides = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    segments = np.concatenate([sides, np.stack([tip[:-1], tip[1:]], axis=1)])
    return SE2(pose).rotate(segments) + pose[:2]


class RouteLine:
    """Dashed line of the planned path, and a ghost of the robot at its goal."""

    def __init__(self, scene: viser.SceneApi, name: str, outline: Array) -> None:
        """`outline` (n, 2) is the robot's, in its frame."""
        self._scene = scene
        self._name = name
        self._outline = outline
        self._themes: list[tuple[str, Palette]] | None = None
        self._nodes: list[viser.SceneNodeHandle] = []

    def update(self, poses: Array | None) -> None:
        """Draw a path through `poses` (n, 3); None removes it."""
        for node in self._nodes:
            node.remove()
        self._nodes.clear()
        if poses is None:
            return
        if self._themes is None:
            self._themes = themed(self._scene, self._name)
        way = dashes(poses[:, :2], _ROUTE_DASH_M, _ROUTE_GAP_M)
        lines = np.concatenate([way, goal_lines(self._outline, poses[-1])])
        at_goal = SE2(poses[-1]).rotate(self._outline) + poses[-1, :2]
        for node, palette in self._themes:
            line = raised(lines, ROUTE_HEIGHT_M), palette.plan, _ROUTE_WIDTH_M
            self._nodes.append(add_lines(self._scene, f"{node}/p", *line))
            area = raised(at_goal, ROUTE_HEIGHT_M), palette.plan, _GOAL_OPACITY
            self._nodes.append(add_area(self._scene, f"{node}/g", *area))

    def remove(self) -> None:
        """Remove the path."""
        self.update(None)
