"""A relay of TCP connections over a simulated link."""

from __future__ import annotations

import asyncio

from tsd_twin.linksim.endpoint import Endpoint
from tsd_twin.linksim.far_side import FarSide
from tsd_twin.linksim.lane import Lane
from tsd_twin.linksim.near_side import NearSide
from tsd_twin.linksim.side import Side, TcpSegment
from tsd_twin.linksim.sockets import bound


class TcpRelay:
    """Accepts connections, and opens one to the target for each."""

    def __init__(
        self, listen: Endpoint, target: Endpoint, up: Lane[TcpSegment], down: Lane[TcpSegment]
    ) -> None:
        self._listen = listen
        self._target = target
        self._up = up
        self._down = down
        self._sides: set[Side] = set()

    async def open(self) -> int:
        """Listen, and return the port.

        Raises:
            LinkError: it cannot listen there.
        """
        listening = bound(self._listen)
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._accept, sock=listening)
        return listening.getsockname()[1]

    async def close(self) -> None:
        """Accept no more, and break all connections."""
        self._server.close()
        for side in tuple(self._sides):
            side.abandon()
        await asyncio.sleep(0)  # The transports say good-bye in the next turn of the loop.
        await self._server.wait_closed()

    def _accept(self) -> NearSide:
        near = NearSide(self._up, self._sides)
        near.other = FarSide(self._down, self._sides, near, self._target)
        return near
