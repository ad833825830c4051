"""The three-dimensional picture of all robots, as it is for everybody who looks."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import msgspec
import viser

from tsd_twin.dashboard.body import Body, Source
from tsd_twin.dashboard.fleet_meshes import FleetMeshes
from tsd_twin.dashboard.ground import add_ground
from tsd_twin.dashboard.layers import OTHERS, ROOT, ROUTES, SCALE, TRAILS, TRUTHS
from tsd_twin.dashboard.pointing import OnClick
from tsd_twin.dashboard.robot_marks import RobotMarks
from tsd_twin.dashboard.shape import Shape
from tsd_twin.lie import Array


class Viewer(Protocol):
    """Who shows clients what is not the same for all of them."""

    def moved(self) -> None:
        """Follow robots that have moved."""
        ...

    def rebuild(self) -> None:
        """Take in that robots have come or gone."""
        ...


class Scene:
    """Robots, ghosts and floor; may be used by any thread.

    The world moves below the first robot, so that a camera that nobody touches follows it, and one
    that somebody turns is not fought over. Clients with other wishes have a world of their own.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self.server = server
        self.lock = threading.RLock()
        """Held while robots come, go or are drawn."""
        self._bodies: dict[str, Body] = {}
        self._fleets: dict[bytes, FleetMeshes] = {}
        self._world = server.scene.add_frame(ROOT, show_axes=False)
        self._viewers: list[Viewer] = []
        self.on_click: OnClick | None = None
        """Called on viser's thread when the ball of a robot is clicked on."""
        add_ground(server.scene, ROOT, SCALE)
        for node in (TRUTHS, OTHERS, TRAILS, ROUTES):
            server.scene.add_frame(node, show_axes=False)

    @property
    def bodies(self) -> Mapping[str, Body]:
        """The robots in the scene, by id, in the order in which they came."""
        return MappingProxyType(self._bodies)

    @property
    def leader(self) -> str | None:
        """The robot that the world moves with, unless a client wishes otherwise."""
        return next(iter(self._bodies), None)

    @property
    def world_xy(self) -> tuple[float, float]:
        """Where the origin of `odom` is in the picture."""
        x, y, _ = self._world.position
        return float(x), float(y)

    def add(self, link: Source) -> None:
        """Show a robot, or show it anew when its id is known; takes a second for a new look."""
        key = msgspec.json.encode(link.robot)
        known = self._fleets.get(key)
        shape = known.shape if known else Shape(link.robot)  # Nobody has to wait for this.
        with self.lock:
            meshes = self._fleets.setdefault(key, FleetMeshes(self.server.scene, shape))
            if link.id in self._bodies:
                self._erase(self._bodies[link.id])
            marks = RobotMarks(self.server.scene, link.id, meshes.shape, self._clicked)
            meshes.add(link.id)
            self._bodies[link.id] = Body(link, meshes, marks)
            self._regroup()

    def remove(self, robot_id: str) -> None:
        """Show a robot no longer; one that is not there is no mistake."""
        with self.lock:
            body = self._bodies.pop(robot_id, None)
            if body is not None:
                self._erase(body)
                self._regroup()

    def draw(self) -> None:
        """Send what the links have heard since the last call, in one piece; if nothing, nothing."""
        with self.lock:
            if not any(body.behind for body in self._bodies.values()):
                return
            with self.server.atomic():
                for body in self._bodies.values():
                    if body.behind:
                        body.update()
                leader = next(iter(self._bodies.values()))
                self._world.position = (-leader.pose[0], -leader.pose[1], 0.0)
                for meshes in self._fleets.values():
                    meshes.send()
            self.server.flush()
            for viewer in self._viewers:
                viewer.moved()

    def mark_stale(self, robot_id: str, stale: bool) -> None:
        """Grey a robot of which nothing new is known."""
        with self.lock:
            if robot_id in self._bodies:
                self._bodies[robot_id].marks.set_stale(stale)

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show where a robot is planned to go, poses (n, 3) in `odom`; None is nowhere."""
        with self.lock:
            if robot_id in self._bodies:
                with self.server.atomic():
                    self._bodies[robot_id].marks.route.update(poses)
                self.server.flush()

    def clear_trails(self) -> None:
        """Forget where the robots were."""
        with self.lock:
            for body in self._bodies.values():
                body.marks.trail.clear()

    def watch(self, viewer: Viewer) -> None:
        """Tell somebody from now on, under the lock, when robots come, go and move."""
        self._viewers.append(viewer)

    def _clicked(
        self, client: viser.ClientHandle, robot_id: str, origin: Array, direction: Array
    ) -> None:
        if self.on_click is not None:
            self.on_click(client, robot_id, origin, direction)

    def _erase(self, body: Body) -> None:
        body.meshes.remove(body.id)
        body.marks.remove()

    def _regroup(self) -> None:
        for body in self._bodies.values():
            body.marks.label.visible = len(self._bodies) > 1
        for viewer in self._viewers:
            viewer.rebuild()
