"""The robots that live on the bus, as they come and go."""

from __future__ import annotations

import logging
import queue
from collections.abc import Callable
from types import MappingProxyType

import msgspec

from tsd_twin import topics
from tsd_twin.bus import Bus
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.errors import TwinError
from tsd_twin.messages.command import Sample
from tsd_twin.messages.service import Event

_LOG = logging.getLogger(__name__)


class Fleet:
    """Links to all living robots; a robot that goes keeps its link, and its state grows old.

    The bus only hands over who came and went, and `refresh`, called by one thread, acts on it.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._links: dict[str, RobotLink] = {}
        self._came: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._events: queue.SimpleQueue[tuple[str, Event]] = queue.SimpleQueue()
        self._on_change: list[Callable[[], None]] = []
        bus.watch_alive(topics.alive_key("*"), self._note)
        bus.watch_events(topics.EVENT.key("*"), self._note_event)

    @property
    def links(self) -> MappingProxyType[str, RobotLink]:
        """All robots seen so far, by id."""
        return MappingProxyType(self._links)

    def on_change(self, call: Callable[[], None]) -> None:
        """Call this, on the thread of `refresh`, when a robot has come."""
        self._on_change.append(call)

    def refresh(self) -> list[str]:
        """Take in who came since the last call, and return their ids; may wait for answers."""
        came: list[str] = []
        while not self._came.empty():
            robot_id = self._came.get()
            try:
                link = RobotLink(self._bus, robot_id)
            except TwinError as error:
                _LOG.warning("robot %s cannot be shown: %s", robot_id, error)
                continue
            if robot_id in self._links:  # It was restarted, perhaps as another robot.
                self._links[robot_id].close()
            self._links[robot_id] = link
            came.append(robot_id)
        if came:
            for call in self._on_change:
                call()
        return came

    def take_events(self) -> list[tuple[str, Event]]:
        """Return (robot, event) for all that happened since the last call."""
        events: list[tuple[str, Event]] = []
        while not self._events.empty():
            events.append(self._events.get())
        return events

    def _note(self, key: str, lives: bool) -> None:
        if lives:
            self._came.put(topics.robot_of(key))

    def _note_event(self, sample: Sample) -> None:
        try:
            event = msgspec.json.decode(sample.payload, type=Event)
        except msgspec.DecodeError:
            return
        self._events.put((topics.robot_of(sample.key), event))
