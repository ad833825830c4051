"""3-D scene shared by all clients: robots, ground grid with metre labels."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from types import MappingProxyType

import msgspec
import numpy as np
import viser

from tsd_twin.dashboard.scene import appearance
from tsd_twin.dashboard.scene.appearance import (
    ALTERNATIVE_POSES,
    AXIS_LABELS,
    ROOT,
    ROUTES,
    TRAILS,
    TRUE_POSES,
    RobotRoster,
)
from tsd_twin.dashboard.scene.overlays import add_lines
from tsd_twin.dashboard.scene.picking import OnClick
from tsd_twin.dashboard.scene.robot_geometry import robot_shape
from tsd_twin.dashboard.scene.robot_overlays import RobotOverlays
from tsd_twin.dashboard.scene.robot_visual import BatchedRobotMeshes, RobotVisual, VisualSource
from tsd_twin.lie import Array

_LETTER_ADVANCE = 0.75
"""Width of a letter including its gap, relative to its height."""
_LOW, _MID, _HIGH, _LEFT, _RIGHT = 0.0, 0.5, 1.0, 0.0, 0.5
_SEGMENTS = {
    "a": (_LEFT, _HIGH, _RIGHT, _HIGH),
    "b": (_RIGHT, _HIGH, _RIGHT, _MID),
    "c": (_RIGHT, _MID, _RIGHT, _LOW),
    "d": (_LEFT, _LOW, _RIGHT, _LOW),
    "e": (_LEFT, _LOW, _LEFT, _MID),
    "f": (_LEFT, _MID, _LEFT, _HIGH),
    "g": (_LEFT, _MID, _RIGHT, _MID),
    "h": (0.25, _LOW, 0.25, _MID),
    "i": (_LEFT, _LOW, _RIGHT, _MID),
    "j": (_LEFT, _MID, _RIGHT, _LOW),
    "k": (_LEFT, _MID, 0.25, 0.2),
    "l": (_LEFT, -0.2, _RIGHT, _MID),
}
"""Segments a to g of a seven-segment digit, and further ones for letters: x and y of both ends."""
_LETTERS = {
    "0": "abcdef",
    "1": "bc",
    "2": "abged",
    "3": "abgcd",
    "4": "fgbc",
    "5": "afgcd",
    "6": "afgedc",
    "7": "abc",
    "8": "abcdefg",
    "9": "abcdfg",
    "-": "g",
    "m": "eghc",
    "x": "ij",
    "y": "kl",
    " ": "",
}


def text_lines(text: str, at_m: tuple[float, float], height_m: float) -> Array:
    """Return the lines (n, 2, 2) of a text on the floor, upright when seen along +X.

    The text starts to the right of `at_m`. Supported characters are digits, minus, m, x and y.
    """
    lines = [
        (np.reshape(_SEGMENTS[bar], (2, 2)) + np.array([i * _LETTER_ADVANCE, 0.0])) * height_m
        for i, letter in enumerate(text)
        for bar in _LETTERS[letter]
    ]
    right_up = np.array(lines)
    # Right is -Y, up is +X.
    return np.stack([right_up[..., 1], -right_up[..., 0]], axis=-1) + np.array(at_m)


LABELLED_RANGE_M = 5
"""Range of the axis labels, metres from the origin."""
_TEXT_HEIGHT_M = 0.07
_TEXT_GAP_M = 0.03


def add_ground(scene: viser.SceneApi, root: str, labels: str) -> None:
    """Add grid and axes below the node `root`, and the labels as node `labels`."""
    scene.world_axes.visible = False  # The default axes do not move with `root`.
    scene.add_grid(
        f"{root}/g",
        infinite_grid=True,
        cell_size=0.1,
        cell_color=appearance.GRID_FINE,
        cell_thickness=0.6,
        section_size=1.0,
        section_color=appearance.GRID_METRE,
        section_thickness=1.3,
        fade_distance=12.0,
        fade_strength=2.0,
        shadow_opacity=0.35,
    )
    scene.add_frame(
        f"{root}/o",
        axes_length=0.12,
        axes_radius=0.002,
        origin_radius=0.004,
        position=(0, 0, 0.004),
    )
    add_lines(scene, labels, _axis_labels(), appearance.GRID_LABEL, 1.5)


def _axis_labels() -> Array:
    """Return the lines (n, 2, 3) of the labels, slightly above the floor."""
    words = [
        text_lines("x", (0.14, -_TEXT_GAP_M), _TEXT_HEIGHT_M),
        text_lines("y", (_TEXT_GAP_M, 0.14), _TEXT_HEIGHT_M),
    ]
    for metres in (m for m in range(-LABELLED_RANGE_M, LABELLED_RANGE_M + 1) if m):
        words.append(
            text_lines(f"{metres} m", (metres + _TEXT_GAP_M, -_TEXT_GAP_M), _TEXT_HEIGHT_M)
        )
        words.append(text_lines(f"{metres} m", (_TEXT_GAP_M, metres - _TEXT_GAP_M), _TEXT_HEIGHT_M))
    flat = np.concatenate(words)
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), 0.002)], axis=-1)


STALE_S = 0.3
"""An older state must not look live."""


class Scene:
    """Scene of robots, overlays and floor, shared by all clients; thread-safe.

    The world frame moves so that the first robot stays in place: an untouched camera follows it,
    and users can turn the camera. Clients with other settings have separate world frames.
    """

    def __init__(self, server: viser.ViserServer, roster: RobotRoster | None = None) -> None:
        self.server = server
        self._roster = roster or RobotRoster()
        self.lock = threading.RLock()
        """Held while robots are added, removed or drawn."""
        self._visuals: dict[str, RobotVisual] = {}
        self._meshes: dict[bytes, BatchedRobotMeshes] = {}
        self._world = server.scene.add_frame(ROOT, show_axes=False)
        self.on_robots_moved: list[Callable[[], None]] = []
        """Called under the lock after robots were moved."""
        self.on_robots_changed: list[Callable[[], None]] = []
        """Called under the lock after robots were added or removed."""
        self.on_click: OnClick | None = None
        """Called on viser's thread if the sphere of a robot is clicked."""
        self.on_trails_cleared: Callable[[], None] = lambda: None
        """Called on viser's thread."""
        add_ground(server.scene, ROOT, AXIS_LABELS)
        for node in (TRUE_POSES, ALTERNATIVE_POSES, TRAILS, ROUTES):
            server.scene.add_frame(node, show_axes=False)

    @property
    def visuals(self) -> Mapping[str, RobotVisual]:
        """Robots in the scene by id, in the order of their addition."""
        return MappingProxyType(self._visuals)

    @property
    def default_robot_id(self) -> str | None:
        """Robot that the world frame follows, unless a client selects another."""
        return next(iter(self._visuals), None)

    @property
    def world_xy(self) -> tuple[float, float]:
        """Origin of `odom` in the scene."""
        x, y, _ = self._world.position
        return float(x), float(y)

    def add(self, link: VisualSource) -> None:
        """Add a robot, or replace the one with the same id; new meshes take a second."""
        key = msgspec.json.encode(link.robot)
        shape = robot_shape(link.robot)  # Slow for a new robot, so outside the lock.
        with self.lock:
            meshes = self._meshes.setdefault(key, BatchedRobotMeshes(self.server.scene, shape))
            if link.id in self._visuals:
                self._remove_visual(self._visuals[link.id])
            overlays = RobotOverlays(
                self.server.scene,
                link.id,
                meshes.shape,
                self._clicked,
                colour=self._roster.colour(link.id),
            )
            meshes.add(link.id)
            self._visuals[link.id] = RobotVisual(link, meshes, overlays)
            self._update_views()

    def remove(self, robot_id: str) -> None:
        """Remove a robot; an unknown id is ignored."""
        with self.lock:
            body = self._visuals.pop(robot_id, None)
            if body is not None:
                self._remove_visual(body)
                self._update_views()

    def draw(self) -> None:
        """Send all changes since the last call in one atomic block."""
        with self.lock:
            if not any(body.is_outdated for body in self._visuals.values()):
                return
            with self.server.atomic():
                for body in self._visuals.values():
                    if body.is_outdated:
                        body.update()
                leader = next(iter(self._visuals.values()))
                self._world.position = (-leader.pose[0], -leader.pose[1], 0.0)
                for meshes in self._meshes.values():
                    meshes.send()
            self.server.flush()
            for call in self.on_robots_moved:
                call()

    def set_stale(self, robot_id: str, stale: bool) -> None:
        """Show a robot as stale."""
        with self.lock:
            if robot_id in self._visuals:
                self._visuals[robot_id].overlays.set_stale(stale)

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show a robot's planned path, poses (n, 3) in `odom`; None removes it."""
        with self.lock:
            if robot_id in self._visuals:
                with self.server.atomic():
                    self._visuals[robot_id].overlays.route.update(poses)
                self.server.flush()

    def clear_trails(self) -> None:
        """Clear the trails of all robots."""
        with self.lock:
            for body in self._visuals.values():
                body.overlays.trail.clear()
        self.on_trails_cleared()

    def envelope(self, robot_id: str) -> Array | None:
        """Return the displayed stop envelope (n, 2) in the robot's frame, or None at rest; never
        waits.
        """
        body = self._visuals.get(robot_id)
        return None if body is None else body.overlays.envelope.outline

    def reach_m(self, robot_id: str) -> float:
        """Return the radius of a robot around its base; 0 if it is not in the scene."""
        body = self._visuals.get(robot_id)
        return 0.0 if body is None else body.meshes.shape.reach_m

    def _clicked(
        self, client: viser.ClientHandle, robot_id: str, origin: Array, direction: Array
    ) -> None:
        if self.on_click is not None:
            self.on_click(client, robot_id, origin, direction)

    def _remove_visual(self, body: RobotVisual) -> None:
        body.meshes.remove(body.id)
        body.overlays.remove()

    def _update_views(self) -> None:
        for body in self._visuals.values():
            body.overlays.set_named(len(self._visuals) > 1)
        for call in self.on_robots_changed:
            call()
