"""The robots that live on the bus, as they come and go."""

from __future__ import annotations

import logging
import queue
import time
from collections import deque
from collections.abc import Callable
from types import MappingProxyType

from tsd_twin import topics
from tsd_twin.bus import Bus
from tsd_twin.dashboard.acquaintance import Acquaintance, Take
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.dashboard.view import RobotView
from tsd_twin.errors import BusError, MessageError, TwinError
from tsd_twin.messages.command import Sample
from tsd_twin.messages.service import Event, decode_json
from tsd_twin.topics import Service

_LOG = logging.getLogger(__name__)

MOST_ROBOTS = 64
"""Robots that are shown; a bus without access rules lets made-up robots in."""
_NAMED = 256
"""Robots of which it is logged once why they cannot be shown."""
_LOGGED = 300
"""Characters of that: what is wrong may quote the description."""
_EVENTS = 1000
"""Events that wait; when more come, the oldest give way."""
_EVENT_BYTES = 16_384
_INSTANCES = 4096


class Fleet:
    """Links to all living robots; a robot that goes keeps its link, and its state grows old.

    A robot that comes is asked for its description and not waited for, so that one that is slow to
    answer, or answers nonsense, keeps no other waiting.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._links: dict[str, RobotLink] = {}
        self._met: queue.SimpleQueue[RobotLink] = queue.SimpleQueue()
        self._events: deque[tuple[str, Event]] = deque(maxlen=_EVENTS)
        self._on_change: list[Callable[[], None]] = []
        self._named: set[str] = set()
        self._instances: dict[str, set[str]] = {}
        self._instance_count = 0
        self._coming = Acquaintance(self._ask, self._meet)
        bus.watch_alive(topics.alive_key("*"), self._note)
        bus.watch_alive(topics.instance_key("*", "*"), self._note_instance)
        bus.watch_events(topics.EVENT.key("*"), self._note_event)

    @property
    def links(self) -> MappingProxyType[str, RobotLink]:
        """All robots seen so far, by id."""
        return MappingProxyType(self._links)

    def on_change(self, call: Callable[[], None]) -> None:
        """Call this, on the thread of `refresh`, when a robot has come."""
        self._on_change.append(call)

    def refresh(self) -> list[str]:
        """Take in who came since the last call, and return their ids."""
        came: list[str] = []
        while not self._met.empty():
            link = self._met.get()
            if link.id in self._links:  # It was restarted, perhaps as another robot.
                self._links[link.id].close()
            elif len(self._links) >= MOST_ROBOTS:
                link.close()
                continue
            self._links[link.id] = link
            came.append(link.id)
        for link in self._links.values():
            link.has_namesake = len(self._instances.get(link.id, ())) > 1
        if came:
            for call in self._on_change:
                call()
        return came

    def _ask(self, robot_id: str, take: Take) -> None:
        try:
            self._bus.request(Service.DESC.key(robot_id), b"", take)
        except BusError:
            take(None)  # The session is closed: the dashboard ends.

    def _meet(self, robot_id: str, answer: bytes) -> None:
        """Link to a robot that has described itself, unless it cannot be shown.

        That one is asked again when it is started anew: until then it says the same.
        """
        if robot_id not in self._links and len(self._links) >= MOST_ROBOTS:
            self._say_once(robot_id, f"{MOST_ROBOTS} robots are shown already")
            return
        try:
            link = RobotLink(self._bus, robot_id, answer)
            RobotView(link).card()  # What cannot be shown is found here, and not by a page.
        except TwinError as error:
            self._say_once(robot_id, str(error))
        except Exception as error:  # Descriptions come from the bus: any of them may do harm.
            self._say_once(robot_id, f"{type(error).__name__}: {error}")
        else:
            if link.ignored:
                event = Event("description", link.ignored, robot_s=time.monotonic())
                self._events.append((robot_id, event))
            self._met.put(link)

    def _say_once(self, robot_id: str, reason: str) -> None:
        if robot_id not in self._named and len(self._named) < _NAMED:
            self._named.add(robot_id)
            _LOG.warning("robot %s cannot be shown: %s", robot_id, reason[:_LOGGED])

    def take_events(self) -> list[tuple[str, Event]]:
        """Return (robot, event) for all that happened since the last call."""
        events: list[tuple[str, Event]] = []
        while self._events:
            events.append(self._events.popleft())
        return events

    def _note(self, key: str, lives: bool) -> None:
        try:
            robot_id = topics.robot_of(key)
        except BusError:
            return  # Anybody may announce anything; a robot has an id.
        if lives:
            self._coming.come(robot_id)
        else:
            self._coming.go(robot_id)

    def _note_instance(self, key: str, lives: bool) -> None:
        try:
            instances = self._instances.setdefault(topics.robot_of(key), set())
        except BusError:
            return
        if lives and key not in instances and self._instance_count < _INSTANCES:
            self._instance_count += 1
            instances.add(key)
        elif not lives and key in instances:
            self._instance_count -= 1
            instances.remove(key)
        if not instances:
            del self._instances[topics.robot_of(key)]

    def _note_event(self, sample: Sample) -> None:
        try:
            robot_id = topics.robot_of(sample.key)
            if len(sample.payload) > _EVENT_BYTES:
                return
            event = decode_json(sample.payload, Event, "an event")
        except (BusError, MessageError):
            return
        self._events.append((robot_id, event))
