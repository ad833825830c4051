"""The right of one page to drive one robot."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Sequence
from functools import partial
from typing import Literal

import numpy as np

from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.link import Driver, RobotLink
from tsd_twin.errors import BusError
from tsd_twin.messages.ros import BASE
from tsd_twin.messages.service import HolderRequest, LeaseRequest, Reply, SpeedRequest
from tsd_twin.messages.status import Status
from tsd_twin.topics import Service

_LOG = logging.getLogger(__name__)

REST_PERIOD_S = 0.02
REST_REPEATS = 25
"""A zero is sent again so often, unless a status shows before that it counted."""
_GRACE_S = 0.3
"""A status that was under way when the lease was granted does not know of it."""


class Control:
    """A lease, as long as it lasts."""

    def __init__(self, link: RobotLink, driver: Driver, calls: Calls) -> None:
        self.link = link
        self._driver = driver
        self._calls = calls
        self._granted_s = time.monotonic()
        self._components = list(link.drive.components)
        self.max_age_s = driver.max_age_s
        """Commands that answer an older word of the robot do not count."""
        self._resting: asyncio.TimerHandle | None = None

    def drive(self, twist: Sequence[float], seen: int, frame: str = BASE) -> None:
        """Send a twist (3,) at once, with the number of the state that its sender has seen."""
        self._rests_no_more()
        self._send(twist, seen, frame)

    def rest(self) -> None:
        """Send a zero, and again every 20 ms until a status of the robot shows that it counted.

        It is said now, so it counts, whatever the page has seen. The bus may lose any command, and
        the one before the zero would stand until it runs out. The next `drive` ends it, as does the
        end of the lease, or half a second.
        """
        self._rests_no_more()
        self._rest(REST_REPEATS, None)

    def _rest(self, left: int, first: int | None) -> None:
        self._resting = None
        status = self.link.snapshot.status
        if first is not None and status is not None:
            if status.command.seq >= first and status.lease.holder == self._driver.operator:
                return
            if self.is_lost(status):
                return
        number = self._send((0.0, 0.0, 0.0), self.link.snapshot.status_seq, BASE)
        if left > 0:
            again = partial(self._rest, left - 1, number if first is None else first)
            self._resting = asyncio.get_running_loop().call_later(REST_PERIOD_S, again)

    def _rests_no_more(self) -> None:
        if self._resting is not None:
            self._resting.cancel()
            self._resting = None

    def _send(self, twist: Sequence[float], seen: int, frame: str) -> int:
        """Send a twist, and return its number; 0 when that was not possible."""
        spatial = np.zeros(6)
        spatial[self._components] = twist
        try:
            return self.link.command(self._driver, spatial, seen, frame)
        except BusError as error:
            _LOG.warning("%s: %s", self.link.id, error)  # The robot stops by itself.
            return 0

    def is_lost(self, status: Status) -> bool:
        """Return whether the robot says that another has control, or nobody."""
        settled = time.monotonic() - self._granted_s > _GRACE_S
        return settled and status.lease.holder != self._driver.operator

    async def ask(self, service: Service) -> Reply:
        """Ask for what only the holder may."""
        return await self._calls.ask(self.link.ask, service, HolderRequest(self._driver.lease_hex))

    async def choose_speed(self, cruise_speed_rpm: float) -> Reply:
        """Ask for another speed of wheels that always spin."""
        request = SpeedRequest(self._driver.lease_hex, cruise_speed_rpm)
        return await self._calls.ask(self.link.ask, Service.SPEED, request)

    async def renew(self) -> None:
        """Keep the lease; whether that worked is seen in the status."""
        await self._calls.ask(
            self.link.ask_lease,
            LeaseRequest(op="renew", operator=self._driver.operator, lease=self._driver.lease_hex),
        )

    async def release(self) -> None:
        """Give the lease back; if that fails, it runs out."""
        await self._calls.ask(
            self.link.ask_lease,
            LeaseRequest(
                op="release", operator=self._driver.operator, lease=self._driver.lease_hex
            ),
        )
        self._rests_no_more()

    async def answer(self, op: Literal["grant", "keep"], asker: str | None) -> Reply:
        """Grant control to who asks for it, or keep it."""
        driver = self._driver
        request = LeaseRequest(op=op, operator=driver.operator, lease=driver.lease_hex, asker=asker)
        reply = await self._calls.ask(self.link.ask_lease, request)
        return Reply(reply.done, reply.reason)


async def acquire(
    link: RobotLink,
    operator: str,
    calls: Calls,
    *,
    take_over: bool,
    max_age_s: float | None,
    reason: str = "",
) -> Control | str:
    """Return control of a robot, or why it is refused."""
    request = LeaseRequest(
        op="acquire", operator=operator, take_over=take_over, max_age_s=max_age_s, reason=reason
    )
    reply = await calls.ask(link.ask_lease, request)
    if not reply.granted or reply.lease is None:
        return reply.reason or "the robot refuses"
    return Control(link, Driver(operator, reply.lease, reply.max_age_s), calls)
