"""What waits to be sent to one page: bounded, and of pictures only the newest."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Protocol

QUEUED = 64
"""Answers and events that wait for a slow page; then the oldest give way."""
UNSEEN = 12
"""States on the way that the page has not confirmed; then it gets no more until it catches up."""


class Socket(Protocol):
    """The part of a WebSocket that is needed here."""

    async def send_str(self, data: str) -> None:
        """Send a text frame; waits while the socket is full."""
        ...


class Mailbox:
    """All methods belong to the event loop.

    A socket that is full is only half of the story: the kernel holds seconds of old pictures.
    The page confirms the states it has seen, so no more than `UNSEEN` are ever on the way.
    """

    def __init__(self) -> None:
        self._letters: deque[str] = deque(maxlen=QUEUED)
        self._panel: str | None = None
        self._state: tuple[int, str] | None = None
        self._unseen: deque[int] = deque()
        self._wake = asyncio.Event()

    def post(self, text: str) -> None:
        """Queue an answer or an event."""
        self._letters.append(text)
        self._wake.set()

    def panel(self, text: str) -> None:
        """Send where the sliders are; replaces what still waits."""
        self._panel = text
        self._wake.set()

    def state(self, number: int, text: str) -> None:
        """Send a state; replaces what still waits."""
        self._state = (number, text)
        self._wake.set()

    def seen(self, number: int) -> None:
        """Note that the page has received the state with this number."""
        if number in self._unseen:
            while self._unseen.popleft() != number:
                pass
            self._wake.set()

    def forget_states(self) -> None:
        """Another robot is watched: its numbers start anew."""
        self._state = None
        self._unseen.clear()

    async def deliver(self, socket: Socket) -> None:
        """Send what waits, for as long as the socket takes it."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while (text := self._next()) is not None:
                await socket.send_str(text)

    def _next(self) -> str | None:
        if self._letters:
            return self._letters.popleft()
        if self._panel is not None:
            text, self._panel = self._panel, None
            return text
        if self._state is not None and len(self._unseen) < UNSEEN:
            (number, text), self._state = self._state, None
            self._unseen.append(number)
            return text
        return None
