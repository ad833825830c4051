"""A relay of datagrams over a simulated link."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import NamedTuple

from tsd_twin.linksim.endpoint import Endpoint
from tsd_twin.linksim.lane import Lane
from tsd_twin.linksim.sockets import Address, bound, datagrams, resolved

HEADER_BYTES = 28
"""IPv4 and UDP; they take their share of the bandwidth."""
CAPACITY_BYTES = 256 * 1024
"""What a link of datagrams holds, on the way and waiting; what comes on top is lost."""
_IDLE_S = 120.0  # What RFC 4787, REQ-5, asks of a NAT at least.


class Datagram(NamedTuple):
    """A datagram, and what sends it on when it arrives."""

    data: bytes
    forward: Callable[[bytes], object]


class UdpRelay:
    """Listens for clients; each gets a socket of its own towards the target, as behind a NAT."""

    def __init__(
        self, listen: Endpoint, target: Endpoint, up: Lane[Datagram], down: Lane[Datagram]
    ) -> None:
        self._listen = listen
        self._target = target
        self._up = up
        self._down = down
        self._loop = asyncio.get_running_loop()
        self._mappings: dict[Address, _Mapping] = {}

    async def open(self) -> int:
        """Listen, and return the port.

        Raises:
            LinkError: it cannot listen there, or nobody knows the target.
        """
        self._family, self._address = resolved(self._target)
        self._socket = bound(self._listen)
        self._loop.add_reader(self._socket, self._from_clients)
        return self._socket.getsockname()[1]

    async def close(self) -> None:
        """Close all sockets."""
        self._loop.remove_reader(self._socket)
        self._socket.close()
        self._forget(before_s=self._loop.time())

    def _from_clients(self) -> None:
        for data, client in datagrams(self._socket):
            mapping = self._mappings.get(client) or self._map(client)
            mapping.used_s = self._loop.time()
            self._up.send(Datagram(data, mapping.socket.send), len(data) + HEADER_BYTES)

    def _from_target(self, mapping: _Mapping, client: Address) -> None:
        def answer(data: bytes) -> None:
            self._socket.sendto(data, client)

        for data, _ in datagrams(mapping.socket):
            mapping.used_s = self._loop.time()
            self._down.send(Datagram(data, answer), len(data) + HEADER_BYTES)

    def _map(self, client: Address) -> _Mapping:
        self._forget(before_s=self._loop.time() - _IDLE_S)
        mapping = _Mapping(socket.socket(self._family, socket.SOCK_DGRAM))
        mapping.socket.setblocking(False)
        mapping.socket.connect(self._address)
        self._loop.add_reader(mapping.socket, self._from_target, mapping, client)
        self._mappings[client] = mapping
        return mapping

    def _forget(self, before_s: float) -> None:
        for client, mapping in list(self._mappings.items()):
            if mapping.used_s <= before_s:
                self._loop.remove_reader(mapping.socket)
                mapping.socket.close()
                del self._mappings[client]


def forward(datagram: Datagram) -> None:
    """Send a datagram on; what the network does not take is lost, as datagrams are."""
    try:
        datagram.forward(datagram.data)
    except OSError:
        return


class _Mapping:
    """A client as the target sees it."""

    def __init__(self, towards_target: socket.socket) -> None:
        self.socket = towards_target
        self.used_s = 0.0
