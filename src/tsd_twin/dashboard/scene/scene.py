"""3-D scene shared by all clients: robots and their overlays."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from types import MappingProxyType

import msgspec
import viser

from tsd_twin.dashboard.scene.appearance import (
    ALTERNATIVE_POSES,
    ROOT,
    ROUTES,
    TRAILS,
    TRUE_POSES,
    RobotRoster,
    Theme,
)
from tsd_twin.dashboard.scene.picking import OnClick
from tsd_twin.dashboard.scene.robot_geometry import robot_shape
from tsd_twin.dashboard.scene.robot_overlays import RobotOverlays
from tsd_twin.dashboard.scene.robot_visual import BatchedRobotMeshes, RobotVisual, VisualSource
from tsd_twin.dashboard.scene.stage import add_lights
from tsd_twin.dashboard.wire.view import TiltFactor
from tsd_twin.lie import Array

STALE_S = 0.3
"""An older state must not look live."""


class Scene:
    """Scene of robots and overlays, shared by all clients; thread-safe.

    The world frame moves so that the first robot stays in place: an untouched camera follows it,
    and users can turn the camera. Clients with other settings have separate world frames.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        roster: RobotRoster | None = None,
        tilt: TiltFactor = TiltFactor.FIVE,
        *,
        separate: bool = False,
    ) -> None:
        """`tilt` is the exaggeration for clients that do not choose another.

        With `separate`, no message is about several robots, so that clients can be limited to some.
        """
        self._separate = separate
        self.server = server
        self._tilt = tilt
        self._roster = roster or RobotRoster()
        self.lock = threading.RLock()
        """Held while robots are added, removed or drawn."""
        self._visuals: dict[str, RobotVisual] = {}
        self._meshes: dict[bytes, BatchedRobotMeshes] = {}
        self._postpones = False
        # Each client replaces these lights. Its first frame would otherwise prepare viser's
        # default lights and reflections, which takes 5 s without a graphics card.
        add_lights(server.scene, Theme.DARK, plain=True)
        self._world = server.scene.add_frame(ROOT, show_axes=False)
        self.on_robots_moved: Callable[[], None] = lambda: None
        """Called under the lock after robots were moved."""
        self.on_robots_changed: Callable[[], None] = lambda: None
        """Called under the lock after robots were added or removed."""
        self.on_click: OnClick | None = None
        """Called on viser's thread if the sphere of a robot is clicked."""
        server.scene.world_axes.visible = False  # They do not move with the world.
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

    @contextmanager
    def one_update(self) -> Generator[None]:
        """Update the views of clients once for all new robots that are added; for one thread."""
        self._postpones = True
        try:
            yield
        finally:
            with self.lock:
                self._postpones = False
                self._update_views()

    def add(self, link: VisualSource) -> None:
        """Add a robot, or replace the one with the same id; new meshes take a second."""
        key = msgspec.json.encode(link.robot) + (link.id.encode() if self._separate else b"")
        shape = robot_shape(link.robot)  # Slow for a new robot, so outside the lock.
        with self.lock:
            meshes = self._meshes.setdefault(key, BatchedRobotMeshes(self.server.scene, shape))
            before = self._visuals.get(link.id)
            if before is not None:
                self._remove_visual(before)
            overlays = RobotOverlays(
                self.server.scene,
                link.id,
                meshes.shape,
                self._clicked,
                colour=self._roster.colour(link.id),
            )
            meshes.add(link.id)
            self._visuals[link.id] = RobotVisual(link, meshes, overlays, self._tilt)
            # Clients have nodes of their own on a robot that is replaced.
            if before is not None or not self._postpones:
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
            self.on_robots_moved()

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
            body.overlays.set_named(self._separate or len(self._visuals) > 1)
        self.on_robots_changed()
