"""The robots that live on the bus, as they come and go."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from types import MappingProxyType

from tsd_twin import topics
from tsd_twin.bus import Bus
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.errors import BusError, MessageError, NoAnswerError, TwinError
from tsd_twin.messages.command import Sample
from tsd_twin.messages.service import Event, decode_json

_LOG = logging.getLogger(__name__)
_AGAIN_S = 0.5


class Fleet:
    """Links to all living robots; a robot that goes keeps its link, and its state grows old.

    A robot that comes is asked for its description on a thread of the fleet, so that one that is
    slow to answer keeps nobody waiting.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._links: dict[str, RobotLink] = {}
        self._living: set[str] = set()
        self._came: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._met: queue.SimpleQueue[RobotLink] = queue.SimpleQueue()
        self._events: queue.SimpleQueue[tuple[str, Event]] = queue.SimpleQueue()
        self._on_change: list[Callable[[], None]] = []
        threading.Thread(target=self._meet, name="fleet", daemon=True).start()
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
        """Take in who came since the last call, and return their ids."""
        came: list[str] = []
        while not self._met.empty():
            link = self._met.get()
            if link.id in self._links:  # It was restarted, perhaps as another robot.
                self._links[link.id].close()
            self._links[link.id] = link
            came.append(link.id)
        if came:
            for call in self._on_change:
                call()
        return came

    def _meet(self) -> None:
        while True:
            robot_id = self._came.get()
            while robot_id in self._living:
                try:
                    self._met.put(RobotLink(self._bus, robot_id))
                    break
                except NoAnswerError:
                    time.sleep(_AGAIN_S)  # It lives, so it will answer; or it will go.
                except TwinError as error:
                    _LOG.warning("robot %s cannot be shown: %s", robot_id, error)
                    break

    def take_events(self) -> list[tuple[str, Event]]:
        """Return (robot, event) for all that happened since the last call."""
        events: list[tuple[str, Event]] = []
        while not self._events.empty():
            events.append(self._events.get())
        return events

    def _note(self, key: str, lives: bool) -> None:
        try:
            robot_id = topics.robot_of(key)
        except BusError:
            return  # Anybody may announce anything; a robot has an id.
        if lives:
            self._living.add(robot_id)
            self._came.put(robot_id)
        else:
            self._living.discard(robot_id)

    def _note_event(self, sample: Sample) -> None:
        try:
            robot_id = topics.robot_of(sample.key)
            event = decode_json(sample.payload, Event, "an event")
        except (BusError, MessageError):
            return
        self._events.put((robot_id, event))
