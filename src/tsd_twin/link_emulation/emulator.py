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
_DIRECTIONS = (0, 1)  # Up and down; each has its own chance.


class Direction(enum.Enum):
    """Direction of a link, seen from the client."""

    UP = enum.auto()
    """Towards the target."""
    DOWN = enum.auto()
    """From the target."""


class LinkEmulator:
    """Relay between clients of `endpoint` and the target that emulates a bad link.

    It relays bytes of any protocol. Use it as a context manager, or call `start` and `close`. All
    methods may be called from any thread, and have taken effect when they return.

    Args:
        spec: what the link does, alike in both directions, each with its own chance.
        listen: where it listens, on this machine only; port 0 takes a free one.
        target: where it connects to; the target may start later.

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
        """Endpoint it listens on, with the actual port."""
        return str(dataclasses.replace(self._listen, port=self._port))

    @property
    def up(self) -> Counters:
        """Counters of the packets towards the target."""
        return self._up.link.counters

    @property
    def down(self) -> Counters:
        """Counters of the packets from the target."""
        return self._down.link.counters

    def stall(self, length_s: float, directions: Collection[Direction] = tuple(Direction)) -> None:
        """Deliver nothing for `length_s` from now on, in some directions, and lose nothing."""
        self._do(lambda channel: channel.stall(length_s), directions)

    def cut(self) -> None:
        """Lose all packets from now on, including those in transit."""
        self._do(lambda channel: channel.cut())

    def restore(self) -> None:
        """End the cut."""
        self._do(lambda channel: channel.restore())

    def set(self, spec: LinkSpec) -> None:
        """Change the specification from now on; the seed has effect at the start only."""
        self._do(lambda channel: channel.change(spec))

    def _do(
        self,
        action: Callable[[LinkChannel[Any]], None],
        directions: Collection[Direction] = tuple(Direction),
    ) -> None:
        if self._thread is None:
            raise LinkError("the link is not running")

        async def act() -> None:
            for direction, channel in ((Direction.UP, self._up), (Direction.DOWN, self._down)):
                if direction in directions:
                    action(channel)

        asyncio.run_coroutine_threadsafe(act(), self._loop).result()

    async def _serve(self, opened: concurrent.futures.Future[int]) -> None:
        self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()
        relay = self._datagrams() if self._listen.protocol == "udp" else self._connections()
        try:
            port = await relay.open()
        except Exception as error:  # The caller of `start` waits for it.
            opened.set_exception(error)
            return
        opened.set_result(port)
        await self._stop.wait()
        for channel in (self._up, self._down):
            channel.close()
        await relay.close()
        _LOG.info("up %s, down %s", self.up, self.down)

    def _connections(self) -> TcpRelay:
        def arrived(segment: TcpSegment) -> None:
            segment.stream.arrived(segment)

        def lost(segment: TcpSegment) -> None:
            segment.stream.lost(segment)

        up, down = (self._channel(i, arrived, lost, math.inf) for i in _DIRECTIONS)
        self._up, self._down = up, down
        return TcpRelay(self._listen, self._target, up, down)

    def _datagrams(self) -> UdpRelay:
        def lost(_datagram: Datagram) -> None:
            return

        up, down = (
            self._channel(direction, forward, lost, CAPACITY_BYTES) for direction in _DIRECTIONS
        )
        self._up, self._down = up, down
        return UdpRelay(self._listen, self._target, up, down)

    def _channel(
        self,
        direction: int,
        arrived: Callable[[Packet], object],
        lost: Callable[[Packet], object],
        capacity_bytes: float,
    ) -> LinkChannel[Packet]:
        random = np.random.default_rng([self._spec.seed, direction])
        link: Link[Packet] = Link(self._spec, random, self._loop.time(), capacity_bytes)
        return LinkChannel(self._loop, link, arrived, lost)
