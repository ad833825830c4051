"""Map data: robot poses, trails, planned paths and the stop envelope."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping

from tsd_twin.dashboard.scene.client_views import SceneExecutor
from tsd_twin.dashboard.scene.robot_visual import VisualSource
from tsd_twin.dashboard.scene.scene import STALE_S
from tsd_twin.dashboard.wire.to_page import FloorPoint, MapLines, MapRobot, MapState
from tsd_twin.lie import SE2, Array

TRAIL_SPACING_M = 0.05
TRAIL_JUMP_M = 0.5
"""A longer step means that the pose was set. The map of the page uses the same two constants."""
TRAIL_POINTS = 800
"""The last 40 m."""


class MapTrail:
    """Path of an estimate, thinned for the map."""

    def __init__(self) -> None:
        self.points: deque[FloorPoint | None] = deque(maxlen=TRAIL_POINTS)
        """Oldest first; None separates discontinuous parts."""
        self._last: FloorPoint | None = None

    def add(self, x_m: float, y_m: float) -> None:
        """Append a position if it is far enough from the last one."""
        here = round(x_m, 3), round(y_m, 3)
        step_m = math.inf if self._last is None else math.dist(here, self._last)
        if step_m < TRAIL_SPACING_M:
            return
        if TRAIL_JUMP_M <= step_m < math.inf:
            self.points.append(None)
        self.points.append(here)
        self._last = here

    def clear(self) -> None:
        """Clear the path."""
        self.points.clear()
        self._last = None


class MapData:
    """Map data and the scene of its pages; event loop only.

    Planned paths pass through this class to the scene, so that both show the same ones.
    """

    def __init__(
        self,
        links: Mapping[str, VisualSource],
        scene: SceneExecutor,
        on_lines: Callable[[], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`links` is a live view of all robots; `on_lines` is called when a path has changed;
        `clock` must be the clock of the states' receive times.
        """
        self._links, self._scene, self._on_lines = links, scene, on_lines
        self._clock = clock
        self._trails: dict[str, MapTrail] = {}
        self._routes: dict[str, list[FloorPoint]] = {}

    def on_status(self, robot_id: str) -> None:
        """Extend the trail of a robot after a new state."""
        pose = self._pose(robot_id)
        if pose is not None:
            self.extend_trail(robot_id, float(pose[0]), float(pose[1]))

    def extend_trail(self, robot_id: str, x_m: float, y_m: float) -> None:
        """Extend the trail of a robot to a position in `odom`."""
        self._trails.setdefault(robot_id, MapTrail()).add(x_m, y_m)

    def clear_trails(self) -> None:
        """Clear the trails of all robots."""
        for trail in self._trails.values():
            trail.clear()

    def state(self, shown: str) -> MapState:
        """Return the moving elements of the map; the page shows robot `shown`."""
        now_s = self._clock()
        robots: list[MapRobot] = []
        for robot_id, link in self._links.items():
            if (pose := self._pose(robot_id)) is None:
                continue
            x, y, heading = (round(float(number), 4) for number in pose)
            stale = link.snapshot.overdue_s(now_s) > STALE_S
            reach_m = round(self._scene.reach_m(robot_id), 3)
            robots.append(MapRobot(robot_id, (x, y, heading), reach_m, stale))
        envelope = self._scene.envelope(shown)
        return MapState(robots, None if envelope is None else _points(envelope))

    def lines(self, *, trails: bool) -> MapLines:
        """Return planned paths and, if requested, trails."""
        points = {robot_id: list(trail.points) for robot_id, trail in self._trails.items()}
        return MapLines(routes=self._routes, trails=points if trails else None)

    def _pose(self, robot_id: str) -> Array | None:
        link = self._links.get(robot_id)
        if link is None or link.snapshot.odom is None or link.kinematics.pose_type is not SE2:
            return None
        return link.snapshot.odom.xy_heading

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show a planned path, poses (n, 3) in `odom`, on all pages; None removes it."""
        if poses is None:
            self._routes.pop(robot_id, None)
        else:
            self._routes[robot_id] = _points(poses)
        self._scene.show_route(robot_id, poses)
        self._on_lines()


def _points(rows: Array) -> list[FloorPoint]:
    return [(round(float(row[0]), 3), round(float(row[1]), 3)) for row in rows]
