"""One page's request for control, from the question to the answer."""

from __future__ import annotations

import time
from enum import StrEnum

from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.dashboard.protocol import AskLease
from tsd_twin.messages.service import LeaseRequest, Reply
from tsd_twin.messages.status import LeaseStatus

_GRACE_S = 0.3
"""A status that was under way when the robot was asked does not know of it."""


class News(StrEnum):
    """What a status says about a request."""

    WAITING = "waiting"
    OURS = "ours"
    """Control is kept for who has asked, or for nobody: take it."""
    OVER = "over"
    """Declined, without an answer, or another has control now."""


class Asking:
    """A request that the robot has taken; its status tells what becomes of it."""

    def __init__(self, link: RobotLink, operator: str, wish: AskLease, calls: Calls) -> None:
        self.link = link
        self.wish = wish
        """What the page would acquire."""
        self._operator = operator
        self._calls = calls
        self._asked_s = time.monotonic()

    async def ask(self) -> Reply:
        """Ask the holder."""
        reply = await self._send(LeaseRequest(op="request", operator=self._operator))
        self._asked_s = time.monotonic()
        return reply

    async def withdraw(self) -> Reply:
        """Ask no longer; if that fails, the request ends by itself."""
        return await self._send(LeaseRequest(op="withdraw", operator=self._operator))

    def news(self, lease: LeaseStatus) -> News:
        """Return what has become of it."""
        if lease.asked_by == self._operator:
            return News.WAITING
        if lease.reserved_for == self._operator:
            return News.OURS
        if lease.holder is None and lease.reserved_for is None:
            return News.OURS
        settled = time.monotonic() - self._asked_s > _GRACE_S
        return News.OVER if settled else News.WAITING

    async def _send(self, request: LeaseRequest) -> Reply:
        reply = await self._calls.ask(self.link.ask_lease, request)
        return Reply(reply.done, reply.reason)
