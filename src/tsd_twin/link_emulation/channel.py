"""Real-time channel of an emulated link, and the sockets of the relays."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeAlias

from tsd_twin.link_emulation.link import LinkModel, Packet, Stream
from tsd_twin.link_emulation.spec import Endpoint, LinkError


class LinkChannel(Generic[Packet]):
    """One direction of a link, run by an event loop in real time.

    After changing `link` from outside, call `step`. The loop sleeps in whole milliseconds, so
    packets may be up to 1 ms late.

    Args:
        loop: Event loop; provides the clock.
        link: Link model, in times of that clock.
        arrived: Called with each delivered packet.
        lost: Called with each packet in flight that a cut drops.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        link: LinkModel[Packet],
        arrived: Callable[[Packet], object],
        lost: Callable[[Packet], object],
    ) -> None:
        self._loop = loop
        self._arrived = arrived
        self._lost = lost
        self._alarm: asyncio.TimerHandle | None = None
        self.link = link
        self.resenders: set[Stream[Any]] = set()
        """Streams whose lost segments are retransmitted."""

    @property
    def now_s(self) -> float:
        """Time on the link's clock."""
        return self._loop.time()

    def send(self, packet: Packet, size_bytes: int) -> None:
        """Send a packet."""
        self.link.send(packet, size_bytes, self.now_s)
        self.step()

    def step(self) -> None:
        """Process all due events and set the timer for the next one."""
        now_s = self.now_s
        for resender in tuple(self.resenders):
            resender.retransmit(now_s)
        for packet in self.link.receive(now_s):
            self._arrived(packet)
        self._set_alarm()

    def cut(self) -> None:
        """Drop all further packets and those in flight."""
        for packet in self.link.cut():
            self._lost(packet)

    def close(self) -> None:
        """Cancel the timer."""
        if self._alarm is not None:
            self._alarm.cancel()

    def _set_alarm(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None
        times_s = [self.link.next_s(), *(resender.next_s() for resender in self.resenders)]
        due_s = min((time_s for time_s in times_s if time_s is not None), default=None)
        if due_s is not None:
            self._alarm = self._loop.call_at(due_s, self.step)


Address: TypeAlias = tuple[Any, ...]
"""Address in the format of the socket module."""
_KINDS = {"tcp": socket.SOCK_STREAM, "udp": socket.SOCK_DGRAM}
_PROTOCOLS = {"tcp": socket.IPPROTO_TCP, "udp": socket.IPPROTO_UDP}
_LARGEST_DATAGRAM = 65536
_AT_A_TIME = 64  # Bounded, so that a flooding client cannot block the loop.


def bound(endpoint: Endpoint) -> socket.socket:
    """Return a socket bound to an endpoint.

    Raises:
        LinkError: If the port is in use, or the host is unknown or not local.
    """
    family, address = resolved(endpoint)
    # Without a protocol asyncio does not set TCP_NODELAY, and the last segment of a message waits
    # 40 ms for the receiver's delayed acknowledgement.
    made = socket.socket(family, _KINDS[endpoint.protocol], _PROTOCOLS[endpoint.protocol])
    try:
        made.setblocking(False)
        if endpoint.protocol == "tcp":
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
    except OSError as error:
        made.close()
        why = (error.strerror or str(error)).lower()
        raise LinkError(f"cannot listen at {endpoint}: {why}") from error
    return made


def resolved(endpoint: Endpoint) -> tuple[socket.AddressFamily, Address]:
    """Return family and address of an endpoint.

    Raises:
        LinkError: If the host name cannot be resolved.
    """
    kind = _KINDS[endpoint.protocol]
    try:
        found = socket.getaddrinfo(endpoint.host, endpoint.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise LinkError(f"the host of {endpoint} cannot be resolved") from error
    family, _, _, _, address = found[0]
    return family, address


def datagrams(receiver: socket.socket) -> Iterator[tuple[bytes, Address]]:
    """Yield queued datagrams of a socket with their senders, without waiting."""
    for _ in range(_AT_A_TIME):
        try:
            received = receiver.recvfrom(_LARGEST_DATAGRAM)
        except BlockingIOError:
            return
        except ConnectionError:  # An earlier datagram found no receiver; more may follow.
            continue
        yield received
