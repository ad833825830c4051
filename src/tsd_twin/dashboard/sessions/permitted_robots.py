"""Part of the robot directory that a page may see."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.sessions.robot_directory import KnownRobot, RobotDirectory
from tsd_twin.dashboard.wire.to_page import MapLines, MapState, RobotName, RobotState
from tsd_twin.messages.events import Event
from tsd_twin.security.router_rules import RobotRights


class PermittedRobots:
    """Robots that a page may watch; all others do not exist for it."""

    def __init__(self, directory: RobotDirectory | PermittedRobots, rights: RobotRights) -> None:
        self._directory = directory
        self.links: Mapping[str, RobotMonitor] = _PermittedLinks(directory.links, rights)
        """Live view of the robots, by id."""

    def robot_names(self) -> list[RobotName]:
        """Return the entries of the robot menu; a new page selects the first."""
        return [name for name in self._directory.robot_names() if name.id in self.links]

    def robot(self, robot_id: str | None) -> KnownRobot | None:
        """Return a robot; a new object after the robot has restarted."""
        return self._directory.robot(robot_id) if robot_id in self.links else None

    def state(self, robot_id: str | None) -> RobotState | None:
        """Return the state of a robot, or None before its first status."""
        return self._directory.state(robot_id) if robot_id in self.links else None

    def events(self, robot_id: str) -> list[tuple[float, Event]]:
        """Return the latest events of a robot with their ages in seconds, oldest first."""
        return self._directory.events(robot_id) if robot_id in self.links else []

    def links_to_stop(self, robot_id: str | None) -> list[RobotMonitor]:
        """Return the robots to stop, for a page that has a robot selected."""
        links = self._directory.links_to_stop(robot_id)
        return [link for link in links if link.id in self.links]

    def on_map(self, state: MapState) -> MapState:
        """Return the moving elements of a map without other robots."""
        return MapState([each for each in state.robots if each.id in self.links], state.envelope)

    def lines_on_map(self, lines: MapLines) -> MapLines:
        """Return planned paths and trails without those of other robots."""
        routes = {each: points for each, points in lines.routes.items() if each in self.links}
        trails = None
        if lines.trails is not None:
            trails = {each: points for each, points in lines.trails.items() if each in self.links}
        return MapLines(routes=routes, trails=trails)


class _PermittedLinks(Mapping[str, RobotMonitor]):
    """Live view of permitted robots."""

    def __init__(self, links: Mapping[str, RobotMonitor], rights: RobotRights) -> None:
        self._links, self._rights = links, rights

    def __getitem__(self, robot_id: str) -> RobotMonitor:
        if not self._rights.may_watch(robot_id):
            raise KeyError(robot_id)
        return self._links[robot_id]

    def __iter__(self) -> Iterator[str]:
        # A copy, because robots appear while it is read.
        return (each for each in list(self._links) if self._rights.may_watch(each))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, robot_id: object) -> bool:
        known = isinstance(robot_id, str) and robot_id in self._links
        return known and self._rights.may_watch(str(robot_id))
