"""Robot discovery: liveliness tokens of robots, and concurrent connection with retries."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from tsd_twin.bus import Bus
from tsd_twin.client.instances import Instances
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.sessions.telemetry import RobotTelemetry
from tsd_twin.errors import BusError, TwinError
from tsd_twin.messages import topics
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import decode_json
from tsd_twin.messages.topics import Sample, Service

_LOG = logging.getLogger(__name__)

MAX_PENDING_ROBOTS = 1024
"""Robots that have not answered yet; when more come, the one gives way that failed most often."""
FIRST_RETRY_S, MAX_RETRY_S = 0.5, 30.0
"""Time until a robot that has not answered is asked again: twice as long each time."""
_QUERY_TIMEOUT_S = 5.0
"""A question that has had no end for so long is asked again."""

TakeReply = Callable[[bytes | None], None]
"""Takes the answer of a robot, or None after a timeout."""


@dataclass(slots=True)
class _PendingRobot:
    """Retry state of a robot without a description."""

    number: int
    """Rises with each coming."""
    due_s: float
    failures: int = 0


class RobotConnector:
    """Requests the description of each discovered robot, with retries.

    Requests do not block, so a silent robot delays no other. One thread does all of it.
    """

    def __init__(
        self,
        send_request: Callable[[str, TakeReply], None],
        on_answer: Callable[[str, bytes], None],
    ) -> None:
        """`send_request` must not block; `on_answer` is called on the thread of this object.

        The response may arrive on any thread.
        """
        self._send_request, self._on_answer = send_request, on_answer
        self._pending: dict[str, _PendingRobot] = {}
        self._answers: deque[tuple[str, int, bytes | None]] = deque(maxlen=MAX_PENDING_ROBOTS)
        self._appearances = 0
        self._changed = threading.Condition()
        threading.Thread(target=self._work, name="fleet", daemon=True).start()

    def add_robot(self, robot_id: str) -> None:
        """Request the description of a robot now, also of a known id, which may be another
        robot.
        """
        with self._changed:
            self._appearances += 1
            turn = self._pending.get(robot_id)
            if turn is None:
                if len(self._pending) >= MAX_PENDING_ROBOTS:
                    del self._pending[
                        max(self._pending, key=lambda each: self._pending[each].failures)
                    ]
                turn = self._pending[robot_id] = _PendingRobot(0, 0.0)
            turn.number, turn.due_s = self._appearances, time.monotonic()
            self._changed.notify()

    def remove_robot(self, robot_id: str) -> None:
        """Stop requests to a robot."""
        with self._changed:
            self._pending.pop(robot_id, None)

    def _answered(self, robot_id: str, number: int, answer: bytes | None) -> None:
        with self._changed:
            self._answers.append((robot_id, number, answer))
            self._changed.notify()

    def _work(self) -> None:
        while True:
            questions, answer = self._next()
            try:
                for robot_id, number in questions:
                    self._send_request(robot_id, partial(self._answered, robot_id, number))
                if answer is not None:
                    self._on_answer(*answer)
            except Exception:  # An error with one robot must not end the thread for others.
                _LOG.exception("a robot cannot be met")

    def _next(self) -> tuple[list[tuple[str, int]], tuple[str, bytes] | None]:
        """Wait, and return the ids to query now, and a received response."""
        with self._changed:
            while True:
                answer = self._answer()
                now_s = time.monotonic()
                due = [(name, turn) for name, turn in self._pending.items() if turn.due_s <= now_s]
                for _, turn in due:
                    turn.due_s = now_s + _QUERY_TIMEOUT_S
                if due or answer is not None:
                    return [(name, turn.number) for name, turn in due], answer
                next_s = min((turn.due_s for turn in self._pending.values()), default=None)
                self._changed.wait(None if next_s is None else next_s - now_s)

    def _answer(self) -> tuple[str, bytes] | None:
        """Received response of a pending robot, and schedule retries of the others."""
        while self._answers:
            robot_id, number, answer = self._answers.popleft()
            turn = self._pending.get(robot_id)
            if turn is None or turn.number != number:
                continue  # It has disappeared, or was restarted and has a newer request.
            if answer is not None:
                del self._pending[robot_id]
                return robot_id, answer
            turn.due_s = time.monotonic() + min(FIRST_RETRY_S * 2.0**turn.failures, MAX_RETRY_S)
            turn.failures = min(turn.failures + 1, 16)
        return None


MOST_ROBOTS = 64
"""Robots that are shown; a bus without access rules lets made-up robots in."""
_NAMED = 256
"""Robots of which it is logged once why they cannot be shown."""
_LOGGED = 300
"""Characters of that: what is wrong may quote the description."""
_EVENTS = 1000
"""Events that wait; when more come, the oldest give way."""
_EVENT_BYTES = 16_384


class RobotDiscovery:
    """Clients of all robots that are alive; a robot that disappears keeps its client, and its state
    ages.

    Descriptions are requested without waiting, so that a robot with a slow or invalid response
    delays no other.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._links: dict[str, RobotMonitor] = {}
        self._fetched: queue.SimpleQueue[RobotMonitor] = queue.SimpleQueue()
        self._events: deque[tuple[str, Event]] = deque(maxlen=_EVENTS)
        self.on_change: Callable[[], None] = lambda: None
        """Called on the thread of `refresh` after robots have appeared."""
        self._named: set[str] = set()
        self._instances = Instances(bus)
        self._coming = RobotConnector(self._request_description, self._fetch_descriptions)
        bus.subscribe_liveliness(topics.alive_key("*"), self._on_liveliness)
        bus.subscribe_events(topics.EVENT.key("*"), self._on_event)

    @property
    def links(self) -> MappingProxyType[str, RobotMonitor]:
        """Live view of all robots seen so far, by id."""
        return MappingProxyType(self._links)

    def refresh(self) -> list[str]:
        """Add robots that appeared since the last call, and return their ids."""
        came: list[str] = []
        while not self._fetched.empty():
            link = self._fetched.get()
            before = self._links.get(link.id)
            if before is None and len(self._links) >= MOST_ROBOTS:
                link.close()
                continue
            self._links[link.id] = link
            came.append(link.id)
            if before is not None:  # It was restarted, perhaps as another robot.
                before.close()
        if came:
            self.on_change()
        return came

    def _request_description(self, robot_id: str, on_reply: TakeReply) -> None:
        try:
            self._bus.request(Service.DESC.key(robot_id), b"", on_reply)
        except BusError:
            on_reply(None)  # The session is closed: the dashboard ends.

    def _fetch_descriptions(self, robot_id: str, answer: bytes) -> None:
        """Create the client of a robot from its description, unless it cannot be shown.

        An invalid one is requested again after a restart of the robot: until then it is the same.
        """
        if robot_id not in self._links and len(self._links) >= MOST_ROBOTS:
            self._log_once(robot_id, f"{MOST_ROBOTS} robots are shown already")
            return
        try:
            link = RobotMonitor(self._bus, robot_id, answer, self._instances)
            RobotTelemetry(link).info()  # Fails here rather than in a page.
        except TwinError as error:
            self._log_once(robot_id, str(error))
        except Exception as error:  # Descriptions come from the bus and are not trusted.
            self._log_once(robot_id, f"{type(error).__name__}: {error}")
        else:
            if link.ignored:
                event = Event("description", link.ignored, robot_s=time.monotonic())
                self._events.append((robot_id, event))
            self._fetched.put(link)

    def _log_once(self, robot_id: str, reason: str) -> None:
        if robot_id not in self._named and len(self._named) < _NAMED:
            self._named.add(robot_id)
            _LOG.warning("robot %s cannot be shown: %s", robot_id, reason[:_LOGGED])

    def take_events(self) -> list[tuple[str, Event]]:
        """Return (robot, event) for all events since the last call."""
        events: list[tuple[str, Event]] = []
        while self._events:
            events.append(self._events.popleft())
        return events

    def _on_liveliness(self, key: str, is_alive: bool) -> None:
        try:
            robot_id = topics.robot_of(key)
        except BusError:
            return  # Liveliness tokens are not authenticated; a robot has a valid id.
        if is_alive:
            self._coming.add_robot(robot_id)
        else:
            self._coming.remove_robot(robot_id)

    def _on_event(self, sample: Sample) -> None:
        try:
            robot_id = topics.robot_of(sample.key)
            if len(sample.payload) > _EVENT_BYTES:
                return
            event = decode_json(sample.payload, Event, "an event")
        except (BusError, MessageError):
            return
        self._events.append((robot_id, event))
