"""Queues of viser that may be filled from any thread.

viser 1.1.1 sets the event of a queue on the thread that fills it, and then once more on the loop
that empties it. The first adds nothing to the second, and fails when the loop begins or ends to
wait at that moment ("deque mutated during iteration"): whatever came after in that frame is lost.
"""

from __future__ import annotations

import asyncio
import sys

import viser.infra
from viser.infra._async_message_buffer import AsyncMessageBuffer

_MAKES_QUEUES = sys.modules[viser.infra.WebsockServer.__module__]
_QUEUE = "AsyncMessageBuffer"


class LoopEvent(asyncio.Event):
    """An event that nothing but its own loop sets; what others do to it is left to be repeated."""

    def __init__(self, home: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._home = home

    def set(self) -> None:
        """Wake who waits, when this is the thread of the loop."""
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            return
        if here is self._home:
            super().set()


class Queue(AsyncMessageBuffer):
    """viser's own, but for the event that says that there is something in it."""

    def __init__(self, event_loop: asyncio.AbstractEventLoop, persistent_messages: bool) -> None:
        super().__init__(event_loop, persistent_messages)
        self.message_event = LoopEvent(event_loop)


def fill_from_any_thread() -> None:
    """Let all queues that viser makes from now on be such ones; calling it again does nothing."""
    setattr(_MAKES_QUEUES, _QUEUE, Queue)
