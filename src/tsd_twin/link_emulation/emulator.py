"""Link emulator: relays between two programs in a thread of its own."""

from __future__ import annotations

import asyncio
import concurrent.futures
import dataclasses
import enum
import logging
import math
import threading
from collections.abc import Callable, Collection
from typing import Any, Self

import numpy as np

from tsd_twin.link_emulation.channel import LinkChannel
from tsd_twin.link_emulation.link import Counters, Link, Packet
from tsd_twin.link_emulation.relays import (
    CAPACITY_BYTES,
    Datagram,
    TcpRelay,
    TcpSegment,
    UdpRelay,
    forward,
)
from tsd_twin.link_emulation.spec import Endpoint, LinkError, LinkSpec

_LOG = logging.getLogger(__name__)
_WAYS = (0, 1)  # Up and down; each has its own chance.


class Way(enum.Enum):
    """One direction of a link, as the one who connects to it sees it."""

    UP = enum.auto()
    """Towards the target."""
    DOWN = enum.auto()
    """From the target."""


class LinkEmulator:
    """Passes on between whoever connects to `endpoint` and the target, as a bad link does.

    What crosses is bytes to it: it knows nothing of Zenoh. Use it as a context manager, or call
    `start` and `close`. All methods may be called from any thread, and what they ask for has
    happened when they return.

    Args:
        spec: what the link does, alike in both directions, each with its own chance.
        listen: where it listens, on this machine only; port 0 takes a free one.
        target: where it connects to; nobody needs to be there yet.

    Raises:
        LinkError: an endpoint is none, or not of the same protocol as the other, or would let
            other machines in.
    """

    def __init__(self, spec: LinkSpec, listen: str, target: str) -> None:
        self._spec = spec
        self._target = Endpoint.parse(target)
        self._listen = Endpoint.parse(listen)
        if self._listen.protocol != self._target.protocol:
            raise LinkError(f"{listen} and {target} must both be tcp or both udp")
        if not self._listen.is_loopback:
            raise LinkError(
                f"{listen} can be reached by other machines, and a simulated link guards nothing: "
                f"listen on {self._listen.protocol}/127.0.0.1:{self._listen.port}"
            )
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Listen.

        Raises:
            LinkError: it cannot.
        """
        opened: concurrent.futures.Future[int] = concurrent.futures.Future()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(opened)), name="link", daemon=True
        )
        self._thread.start()
        try:
            self._port = opened.result()
        except Exception:  # Whatever it was, it goes on to the caller, without a thread left.
            self._thread.join()
            self._thread = None
            raise

    def close(self) -> None:
        """Break all connections, and end; calling it again does nothing."""
        if self._thread is not None:
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()
            self._thread = None

    @property
    def endpoint(self) -> str:
        """Where it listens, with the port that 0 became."""
        return str(dataclasses.replace(self._listen, port=self._port))

    @property
    def up(self) -> Counters:
        """What became of the packets towards the target."""
        return self._up.link.counters

    @property
    def down(self) -> Counters:
        """What became of the packets from the target."""
        return self._down.link.counters

    def stall(self, length_s: float, ways: Collection[Way] = tuple(Way)) -> None:
        """Deliver nothing for `length_s` from now on, in some ways, and lose nothing."""
        self._do(lambda lane: lane.stall(length_s), ways)

    def cut(self) -> None:
        """Lose everything from now on, also what is on its way."""
        self._do(lambda lane: lane.cut())

    def mend(self) -> None:
        """End the cut."""
        self._do(lambda lane: lane.mend())

    def set(self, spec: LinkSpec) -> None:
        """Be another link from now on; its seed counts at the start only."""
        self._do(lambda lane: lane.change(spec))

    def _do(
        self, action: Callable[[LinkChannel[Any]], None], ways: Collection[Way] = tuple(Way)
    ) -> None:
        if self._thread is None:
            raise LinkError("the link is not running")

        async def act() -> None:
            for way, lane in ((Way.UP, self._up), (Way.DOWN, self._down)):
                if way in ways:
                    action(lane)

        asyncio.run_coroutine_threadsafe(act(), self._loop).result()

    async def _serve(self, opened: concurrent.futures.Future[int]) -> None:
        self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()
        relay = self._datagrams() if self._listen.protocol == "udp" else self._connections()
        try:
            port = await relay.open()
        except Exception as error:  # Whoever called `start` is waiting for it.
            opened.set_exception(error)
            return
        opened.set_result(port)
        await self._stop.wait()
        for lane in (self._up, self._down):
            lane.close()
        await relay.close()
        _LOG.info("up %s, down %s", self.up, self.down)

    def _connections(self) -> TcpRelay:
        def arrived(segment: TcpSegment) -> None:
            segment.stream.arrived(segment)

        def lost(segment: TcpSegment) -> None:
            segment.stream.lost(segment)

        up, down = (self._lane(way, arrived, lost, math.inf) for way in _WAYS)
        self._up, self._down = up, down
        return TcpRelay(self._listen, self._target, up, down)

    def _datagrams(self) -> UdpRelay:
        def lost(_datagram: Datagram) -> None:
            return

        up, down = (self._lane(way, forward, lost, CAPACITY_BYTES) for way in _WAYS)
        self._up, self._down = up, down
        return UdpRelay(self._listen, self._target, up, down)

    def _lane(
        self,
        way: int,
        arrived: Callable[[Packet], object],
        lost: Callable[[Packet], object],
        capacity_bytes: float,
    ) -> LinkChannel[Packet]:
        random = np.random.default_rng([self._spec.seed, way])
        link: Link[Packet] = Link(self._spec, random, self._loop.time(), capacity_bytes)
        return LinkChannel(self._loop, link, arrived, lost)
