"""Queue of messages to one page, which drops old states and spreads the others over its sockets."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence

from aiohttp import web

MAX_QUEUED = 64
"""Maximum number of replies and events queued for a slow page; the oldest are dropped first."""
MAX_UNACKNOWLEDGED = 12
"""Maximum number of unacknowledged states; further states wait for an acknowledgement."""


class Lane:
    """Additional socket of a page, so that a lost segment stalls only some messages."""

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self.socket = socket
        self._messages: deque[str] = deque(maxlen=MAX_UNACKNOWLEDGED)
        self._wake = asyncio.Event()

    @property
    def is_idle(self) -> bool:
        """Whether all messages have been passed to the kernel."""
        return not self._messages

    def put(self, text: str) -> None:
        """Queue a message."""
        self._messages.append(text)
        self._wake.set()

    async def run(self) -> None:
        """Send queued messages until the socket is closed."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._messages:
                await self.socket.send_str(self._messages[0])
                self._messages.popleft()


class SendQueue:
    """Per-page send queue, which keeps only the latest state; event loop only.

    Back pressure is not sufficient, because the kernel buffers seconds of old states. The page
    acknowledges states, so at most `MAX_UNACKNOWLEDGED` are in flight. States take turns on the
    main socket and the idle lanes; all other messages use the main socket, in order.
    """

    def __init__(self) -> None:
        self._turns: deque[Lane | None] = deque([None])  # None is the main socket.
        self._messages: deque[str] = deque(maxlen=MAX_QUEUED)
        self._latest: dict[str, str] = {}
        self._fleet: str | None = None
        self._state: tuple[int, str] | None = None
        self._sent: int | None = None
        self._unacknowledged: deque[int] = deque()
        self._wake = asyncio.Event()

    @property
    def lanes(self) -> Sequence[Lane]:
        """Lanes of the page."""
        return [lane for lane in self._turns if lane is not None]

    def add_lane(self, lane: Lane) -> None:
        """Send states over a lane, too."""
        self._turns.append(lane)

    def remove_lane(self, lane: Lane) -> None:
        """Send nothing more over a lane."""
        self._turns.remove(lane)

    def put(self, text: str) -> None:
        """Queue a reply or an event."""
        self._messages.append(text)
        self._wake.set()

    def put_latest(self, kind: str, text: str) -> None:
        """Queue a message, replacing any of its kind that is waiting."""
        self._latest[kind] = text
        self._wake.set()

    def put_fleet(self, changes: str, whole: Callable[[], str]) -> None:
        """Queue changes of the fleet, or the whole fleet if earlier changes are still waiting."""
        self._fleet = changes if self._fleet is None else whole()
        self._wake.set()

    def put_state(self, number: int, text: str) -> None:
        """Queue a state, replacing any that is waiting; each number is sent once."""
        if number != self._sent:
            self._state = (number, text)
            self._wake.set()

    def acknowledge(self, number: int) -> None:
        """Record that the page has received the state with this number."""
        if number in self._unacknowledged:
            while self._unacknowledged.popleft() != number:
                pass
            self._wake.set()

    def drop_states(self) -> None:
        """Discard waiting states after another robot is selected, because its numbers restart."""
        self._state = self._sent = None
        self._unacknowledged.clear()

    async def run(self, socket: web.WebSocketResponse) -> None:
        """Send queued messages until the socket is closed."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while (text := self._next()) is not None:
                await socket.send_str(text)

    def _next(self) -> str | None:
        if self._messages:
            return self._messages.popleft()
        if self._latest:
            return self._latest.pop(next(iter(self._latest)))
        if len(self._unacknowledged) >= MAX_UNACKNOWLEDGED:
            return None
        if self._fleet is not None:
            text, self._fleet = self._fleet, None
            return text
        if self._state is not None:
            (number, text), self._state = self._state, None
            self._sent = number
            self._unacknowledged.append(number)
            lane = self._next_turn()
            if lane is None:
                return text
            lane.put(text)
        return None

    def _next_turn(self) -> Lane | None:
        """Return the next idle lane, or None for the main socket."""
        while True:
            self._turns.rotate(-1)
            lane = self._turns[-1]
            if lane is None or lane.is_idle:
                return lane
