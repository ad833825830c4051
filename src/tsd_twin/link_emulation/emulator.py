"""Link emulator: relays between two programs, run by a separate thread."""

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
from tsd_twin.link_emulation.link import Counters, LinkModel, Packet
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


class Direction(enum.Enum):
    """Direction of a link, seen from the client."""

    UP = enum.auto()
    """Towards the target."""
    DOWN = enum.auto()
    """From the target."""


class LinkEmulator:
    """Relay between clients of `endpoint` and the target that emulates a bad link.

    It relays any protocol. Use it as a context manager, or call `start` and `close`. All methods
    are thread-safe and take effect before they return.

    Args:
        spec: Link properties, equal in both directions but with independent randomness.
        listen: Listening endpoint, on this machine only; port 0 picks a free one.
        target: Endpoint to connect to; the target may start later.

    Raises:
        LinkError: If an endpoint is malformed, the protocols differ, or other machines could
            connect.
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
        self._channels: dict[Direction, LinkChannel[Any]] = {}

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Start listening.

        Raises:
            LinkError: If it cannot listen.
        """
        opened: concurrent.futures.Future[int] = concurrent.futures.Future()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(opened)), name="link", daemon=True
        )
        self._thread.start()
        try:
            self._port = opened.result()
        except Exception:  # Stop the thread, then pass any error to the caller.
            self._thread.join()
            self._thread = None
            raise

    def close(self) -> None:
        """Break all connections and stop; calling it again has no effect."""
        if self._thread is not None:
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()
            self._thread = None

    @property
    def endpoint(self) -> str:
        """Listening endpoint with the actual port."""
        return str(dataclasses.replace(self._listen, port=self._port))

    @property
    def up(self) -> Counters:
        """Counters of packets sent to the target."""
        return self._channels[Direction.UP].link.counters

    @property
    def down(self) -> Counters:
        """Counters of packets sent by the target."""
        return self._channels[Direction.DOWN].link.counters

    def stall(self, length_s: float, directions: Collection[Direction] = tuple(Direction)) -> None:
        """Deliver nothing for `length_s` in the given directions, without losing packets."""
        self._do(lambda channel: channel.link.stall(length_s, channel.now_s), directions)

    def cut(self) -> None:
        """Drop all further packets and those in flight."""
        self._do(lambda channel: channel.cut())

    def restore(self) -> None:
        """End the cut."""
        self._do(lambda channel: channel.link.restore())

    def set(self, spec: LinkSpec) -> None:
        """Replace the specification; the new seed is ignored."""
        self._do(lambda channel: channel.link.change(spec, channel.now_s))

    def _do(
        self,
        action: Callable[[LinkChannel[Any]], None],
        directions: Collection[Direction] = tuple(Direction),
    ) -> None:
        if self._thread is None:
            raise LinkError("the link is not running")

        async def act() -> None:
            for direction, channel in self._channels.items():
                if direction in directions:
                    action(channel)
                    channel.step()

        asyncio.run_coroutine_threadsafe(act(), self._loop).result()

    async def _serve(self, opened: concurrent.futures.Future[int]) -> None:
        self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()
        relay = self._datagrams() if self._listen.protocol == "udp" else self._connections()
        try:
            port = await relay.open()
        except Exception as error:  # Passed to the caller of `start`.
            opened.set_exception(error)
            return
        opened.set_result(port)
        await self._stop.wait()
        for channel in self._channels.values():
            channel.close()
        await relay.close()
        _LOG.info("up %s, down %s", self.up, self.down)

    def _connections(self) -> TcpRelay:
        def arrived(segment: TcpSegment) -> None:
            segment.stream.arrived(segment)

        def lost(segment: TcpSegment) -> None:
            segment.stream.lost(segment)

        return TcpRelay(self._listen, self._target, *self._open(arrived, lost, math.inf))

    def _datagrams(self) -> UdpRelay:
        def lost(_datagram: Datagram) -> None:
            return

        return UdpRelay(self._listen, self._target, *self._open(forward, lost, CAPACITY_BYTES))

    def _open(
        self,
        arrived: Callable[[Packet], object],
        lost: Callable[[Packet], object],
        capacity_bytes: float,
    ) -> tuple[LinkChannel[Packet], LinkChannel[Packet]]:
        def channel(number: int) -> LinkChannel[Packet]:
            random = np.random.default_rng([self._spec.seed, number])
            link: LinkModel[Packet] = LinkModel(
                self._spec, random, self._loop.time(), capacity_bytes
            )
            return LinkChannel(self._loop, link, arrived, lost)

        up, down = channel(0), channel(1)  # With independent random streams.
        self._channels = {Direction.UP: up, Direction.DOWN: down}
        return up, down
