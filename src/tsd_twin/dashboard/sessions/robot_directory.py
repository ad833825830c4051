"""State, events, health and round-trip times of all discovered robots."""

from __future__ import annotations

import asyncio
import bisect
import itertools
import math
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter

from tsd_twin.client import procedures
from tsd_twin.client.monitor import RobotMonitor, Snapshot
from tsd_twin.dashboard.scene.appearance import RobotRoster
from tsd_twin.dashboard.sessions.lease import RpcExecutor
from tsd_twin.dashboard.sessions.shadow_monitor import ShadowMonitor
from tsd_twin.dashboard.sessions.shadow_process import ShadowProcess
from tsd_twin.dashboard.sessions.telemetry import RobotTelemetry
from tsd_twin.dashboard.wire.from_page import LOOK_BACK_S
from tsd_twin.dashboard.wire.to_page import MapLines, MapState, RobotName, RobotState
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import ARMED
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights

SPACING_S = 0.1
_SLACK_S = 1.0
"""Extra history, so that the oldest time a page can request is still stored."""


class StateHistory:
    """Snapshots of a robot, at least `SPACING_S` apart."""

    def __init__(self) -> None:
        self._kept: deque[Snapshot] = deque()

    def add(self, snapshot: Snapshot) -> None:
        """Store a snapshot if enough time has passed since the last stored one."""
        now_s = snapshot.received_s
        # Allow for the jitter of the status period.
        if self._kept and now_s - self._kept[-1].received_s < SPACING_S - 0.01:
            return
        self._kept.append(snapshot)
        while self._kept[0].received_s < now_s - LOOK_BACK_S - _SLACK_S:
            self._kept.popleft()

    def at(self, received_s: float) -> Snapshot | None:
        """Return the latest snapshot up to a time, or None if the history starts later."""
        count = bisect.bisect_right(self._kept, received_s, key=attrgetter("received_s"))
        return self._kept[count - 1] if count else None


MAX_ROBOTS = 64
MAX_EVENTS = 30
"""Maximum number of past events sent to a new page."""
LIVE_TIMEOUT_S = 1.0
"""A robot is not live when a state is overdue for this time."""
_PING_PERIOD_S = 0.25
_OPERATOR = "gateway"
_IDLE_PINGS = 4
"""Ping interval of a robot that is neither shown nor driven, in periods."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownRobot:
    """Robot with everything that is derived from its messages."""

    link: RobotMonitor
    telemetry: RobotTelemetry
    shadow: ShadowMonitor
    history: StateHistory

    def past(self, ago_s: float) -> Snapshot | None:
        """Return a past snapshot, or None if no page was open at that time."""
        return self.history.at(self.link.snapshot.received_s - ago_s)


class RobotDirectory:
    """All robots with their latest states and events; event loop only."""

    def __init__(
        self,
        links: Mapping[str, RobotMonitor],
        executor: RpcExecutor,
        roster: RobotRoster | None = None,
    ) -> None:
        self.links = links
        """Live view of all robots, by id."""
        self._executor = executor
        self._roster = roster or RobotRoster()
        self._robots: dict[str, KnownRobot] = {}
        self._shadows = ShadowProcess()
        self._events: dict[str, deque[tuple[float, Event]]] = {}
        self._modes: dict[str, tuple[str, float]] = {}
        self._measuring: set[asyncio.Task[None]] = set()

    def robot_names(self) -> list[RobotName]:
        """Return the entries of the robot menu; a new page selects the first."""
        links, roster = self.links, self._roster
        return [
            RobotName(robot_id, links[robot_id].robot.title, roster.css_colour(robot_id))
            for robot_id in roster.in_order(links)
        ]

    def robot(self, robot_id: str | None) -> KnownRobot | None:
        """Return a robot; a new object after the robot has restarted."""
        link = self.links.get(robot_id) if robot_id is not None else None
        if link is None:
            return None
        known = self._robots.get(link.id)
        if known is None or known.link is not link:
            if known is not None:
                known.shadow.end()
            known = KnownRobot(
                link, RobotTelemetry(link), ShadowMonitor(link, self._shadows), StateHistory()
            )
            self._robots[link.id] = known
        return known

    def state(self, robot_id: str | None) -> RobotState | None:
        """Return the state of a robot, or None before its first status."""
        known = self.robot(robot_id)
        snapshot = None if known is None else known.link.snapshot
        if known is None or snapshot is None or snapshot.status is None:
            return None
        now_s = time.monotonic()
        mode_age_s = now_s - self._mode_since_s(known.link.id, snapshot.status.mode)
        return known.telemetry.state(snapshot, now_s, mode_age_s)

    def close(self) -> None:
        """End all shadow twins."""
        for known in self._robots.values():
            known.shadow.close()
        self._shadows.close()

    def add_event(self, robot_id: str, event: Event) -> None:
        """Store an event, which may arrive before its robot is discovered."""
        if robot_id not in self._events and len(self._events) >= MAX_ROBOTS:
            return  # Robot ids on the bus are not authenticated.
        events = self._events.setdefault(robot_id, deque(maxlen=MAX_EVENTS))
        events.append((time.monotonic(), event))

    def events(self, robot_id: str) -> list[tuple[float, Event]]:
        """Return the latest events of a robot with their ages in seconds, oldest first."""
        now_s = time.monotonic()
        return [(now_s - came_s, event) for came_s, event in self._events.get(robot_id, ())]

    def latest_event(self, robot_id: str) -> tuple[float, Event] | None:
        """Return the latest event of a robot with its age in seconds, if any."""
        if not (events := self._events.get(robot_id)):
            return None
        came_s, event = events[-1]
        return time.monotonic() - came_s, event

    def health(self) -> dict[str, dict[str, str | float | None]]:
        """Return the mode and state age of each robot; null before its first status."""
        health: dict[str, dict[str, str | float | None]] = {}
        for robot_id, link in list(self.links.items()):
            snapshot = link.snapshot
            status, age_s = snapshot.status, time.monotonic() - snapshot.received_s
            health[robot_id] = {
                "mode": status.mode if status else None,
                "age_s": round(age_s, 3) if math.isfinite(age_s) else None,
            }
        return health

    def has_live_robot(self, rights: RobotRights = EVERY_ROBOT) -> bool:
        """Return whether a robot that may be watched has sent a state recently."""
        return any(
            _is_live(link) and rights.may_watch(robot_id)
            for robot_id, link in list(self.links.items())
        )

    def note_status(self, robot_id: str) -> None:
        """Record the latest state in the robot's history, and the time of its last mode change."""
        known = self.robot(robot_id)
        if known is None or (status := known.link.snapshot.status) is None:
            return
        self._mode_since_s(robot_id, status.mode)
        known.history.add(known.link.snapshot)

    def on_map(self, state: MapState) -> MapState:
        """Return the moving elements of a map that pages may see, here all."""
        return state

    def lines_on_map(self, lines: MapLines) -> MapLines:
        """Return the planned paths and trails that pages may see, here all."""
        return lines

    def links_to_stop(self, robot_id: str | None) -> list[RobotMonitor]:
        """Return the robots to stop, for a page that has a robot selected.

        These are all live robots if the page shows a recording or no robot. Replays cannot be
        stopped.
        """
        links = list(self.links.values())
        shown = [link for link in links if link.id == robot_id and not link.is_recording]
        return shown or [link for link in links if not link.is_recording]

    async def measure_round_trips(self) -> None:
        """Measure the round-trip times of robots; runs until cancelled.

        Measures four times a second, or once a second for robots that are neither shown nor driven.
        """
        for period in itertools.count():
            await asyncio.sleep(_PING_PERIOD_S)
            self._measuring = {task for task in self._measuring if not task.done()}
            busy = {task.get_name() for task in self._measuring}
            for link in list(self.links.values()):
                if period % _IDLE_PINGS and not link.is_streaming:
                    continue
                answers = not link.has_duplicate and _is_live(link)
                if answers and link.snapshot.status and link.snapshot.status.mode in ARMED:
                    self._follow(link.id)
                if answers and link.id not in busy:
                    self._measuring.add(asyncio.create_task(self._measure(link), name=link.id))

    def _follow(self, robot_id: str) -> None:
        """Run the shadow twin of a robot that is driven, whether or not a page shows it."""
        known = self.robot(robot_id)
        if known is not None:
            known.shadow.follow()

    def _mode_since_s(self, robot_id: str, mode: str) -> float:
        """Return when a robot was first seen in its current mode."""
        known = self._modes.get(robot_id)
        if known is None or known[0] != mode:
            self._modes[robot_id] = known = (mode, time.monotonic())
        return known[1]

    async def _measure(self, link: RobotMonitor) -> None:
        took_s = await self._executor.measure(link, procedures.peek(_OPERATOR))
        if took_s is None:
            link.round_trips.clear()
        else:
            link.round_trips.add(took_s)


def _is_live(link: RobotMonitor) -> bool:
    return link.snapshot.overdue_s(time.monotonic()) < LIVE_TIMEOUT_S
