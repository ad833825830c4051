"""The robots of the fleet as pages see them."""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol

from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.dashboard.protocol import RobotName, State
from tsd_twin.dashboard.view import RobotView
from tsd_twin.messages.service import Event, LeaseRequest

ROBOTS_REMEMBERED = 64
EVENTS_SHOWN = 30
"""Events of a robot that a page gets which comes later."""
FRESH_S = 1.0
"""A robot that has said nothing for longer is not there."""
_MEASURE_S = 0.25


class Fleet(Protocol):
    """What is needed of the fleet."""

    @property
    def links(self) -> Mapping[str, RobotLink]:
        """All robots, by id."""
        ...

    def on_change(self, call: Callable[[], None]) -> None:
        """Call this, on any thread, when robots have come or gone."""
        ...


class Roster:
    """All methods belong to the event loop."""

    def __init__(self, fleet: Fleet, calls: Calls) -> None:
        self._fleet = fleet
        self._calls = calls
        self._views: dict[str, RobotView] = {}
        self._events: dict[str, deque[Event]] = {}
        self._modes: dict[str, tuple[str, float]] = {}
        self._peeking: set[asyncio.Task[None]] = set()

    def names(self) -> list[RobotName]:
        """Return the lines of the robot menu, by id."""
        links = self._fleet.links
        return [RobotName(name, links[name].robot.title) for name in sorted(links)]

    def view(self, robot_id: str | None) -> RobotView | None:
        """Return the view of a robot; a new one when it has been restarted."""
        link = self._fleet.links.get(robot_id) if robot_id is not None else None
        if link is None:
            return None
        if link.id not in self._views or self._views[link.id].link is not link:
            self._views[link.id] = RobotView(link)
        return self._views[link.id]

    def state(self, robot_id: str | None) -> State | None:
        """Return the state of a robot, None when it has not said it yet."""
        view = self.view(robot_id)
        if view is None:
            return None
        snapshot = view.link.snapshot
        if snapshot.status is None:
            return None
        now_s = time.monotonic()
        return view.state(
            snapshot,
            snapshot.status,
            now_s,
            mode_age_s=now_s - self._mode_since_s(view.link.id, snapshot.status.mode),
            trips=view.link.trips,
        )

    def note(self, robot_id: str, event: Event) -> None:
        """Remember an event; it may come before its robot is known."""
        if robot_id not in self._events and len(self._events) >= ROBOTS_REMEMBERED:
            return  # Anybody may make up robots.
        self._events.setdefault(robot_id, deque(maxlen=EVENTS_SHOWN)).append(event)

    def events(self, robot_id: str) -> list[Event]:
        """Return the newest events of a robot, oldest first."""
        return list(self._events.get(robot_id, ()))

    def health(self) -> dict[str, dict[str, str | float | None]]:
        """Return mode and age of the state of each robot; null when it has said nothing."""
        health: dict[str, dict[str, str | float | None]] = {}
        for robot_id, link in list(self._fleet.links.items()):
            status, age_s = link.snapshot.status, _age_s(link)
            health[robot_id] = {
                "mode": status.mode if status else None,
                "age_s": round(age_s, 3) if math.isfinite(age_s) else None,
            }
        return health

    def sees_a_robot(self) -> bool:
        """Return whether any robot has been heard of lately."""
        return any(_age_s(link) < FRESH_S for link in list(self._fleet.links.values()))

    async def measure(self) -> None:
        """Measure, four times a second, how long robots take to answer; ends by cancellation."""
        while True:
            await asyncio.sleep(_MEASURE_S)
            self._peeking = {task for task in self._peeking if not task.done()}
            busy = {task.get_name() for task in self._peeking}
            for link in list(self._fleet.links.values()):
                if _age_s(link) < FRESH_S and link.id not in busy:
                    self._peeking.add(asyncio.create_task(self._peek(link), name=link.id))

    def _mode_since_s(self, robot_id: str, mode: str) -> float:
        """Note the mode of a robot, and return when it was first seen in it."""
        known = self._modes.get(robot_id)
        if known is None or known[0] != mode:
            self._modes[robot_id] = known = (mode, time.monotonic())
        return known[1]

    async def _peek(self, link: RobotLink) -> None:
        request = LeaseRequest(op="peek", operator="gateway")
        took_s, answered = await self._calls.ask(_timed, link, request)
        if answered:
            link.trips.add(took_s)
        else:
            link.trips.forget()


def _timed(link: RobotLink, request: LeaseRequest) -> tuple[float, bool]:
    start_s = time.perf_counter()
    reply = link.ask_lease(request)
    # Who looks is granted nothing, and only silence has a reason.
    return time.perf_counter() - start_s, not reply.reason


def _age_s(link: RobotLink) -> float:
    return time.monotonic() - link.snapshot.received_s
