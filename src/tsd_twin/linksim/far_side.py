"""The socket towards the target."""

from __future__ import annotations

import asyncio
import logging

from tsd_twin.linksim.endpoint import Endpoint
from tsd_twin.linksim.lane import Lane
from tsd_twin.linksim.near_side import NearSide
from tsd_twin.linksim.side import Mark, Side, TcpSegment

_LOG = logging.getLogger(__name__)


class FarSide(Side):
    """Connects when the client's call arrives, and says so, or that nobody answers."""

    def __init__(
        self, lane: Lane[TcpSegment], sides: set[Side], near: NearSide, target: Endpoint
    ) -> None:
        super().__init__(lane, sides)
        self.other = near
        self._target = target
        self._dialling: asyncio.Task[None]

    def opened(self) -> None:
        """Connect, unless the client has given up."""
        if not self._abandoned:
            # Kept, since the loop alone does not keep a task alive.
            self._dialling = asyncio.create_task(self._dial())

    async def _dial(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            await loop.create_connection(lambda: self, self._target.host, self._target.port)
        except (OSError, UnicodeError) as error:
            _LOG.info("nobody answers at %s: %s", self._target, error)
            self._sides.discard(self)
            if not self._abandoned:
                self.carry(Mark.RESET)
