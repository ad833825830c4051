"""Sockets as the relays need them."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any, TypeAlias

from tsd_twin.linksim.endpoint import Endpoint
from tsd_twin.linksim.errors import LinkError

Address: TypeAlias = tuple[Any, ...]
"""As the functions of the socket module take and give it."""
_KINDS = {"tcp": socket.SOCK_STREAM, "udp": socket.SOCK_DGRAM}
_LARGEST_DATAGRAM = 65536
_AT_A_TIME = 64  # So that one client that floods cannot hold up the loop.


def bound(endpoint: Endpoint) -> socket.socket:
    """Return a socket bound to an endpoint.

    Raises:
        LinkError: the port is in use, or the host is unknown or not of this machine.
    """
    family, address = resolved(endpoint)
    made = socket.socket(family, _KINDS[endpoint.protocol])
    try:
        made.setblocking(False)
        if endpoint.protocol == "tcp":
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
    except OSError as error:
        made.close()
        raise LinkError(f"cannot listen at {endpoint}: {_reason(error)}") from error
    return made


def resolved(endpoint: Endpoint) -> tuple[socket.AddressFamily, Address]:
    """Return family and address of an endpoint.

    Raises:
        LinkError: nobody knows the host.
    """
    kind = _KINDS[endpoint.protocol]
    try:
        found = socket.getaddrinfo(endpoint.host, endpoint.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise LinkError(f"nobody knows the host of {endpoint}") from error
    family, _, _, _, address = found[0]
    return family, address


def datagrams(receiver: socket.socket) -> Iterator[tuple[bytes, Address]]:
    """Yield what waits in a socket, each with the address of its sender, without waiting."""
    for _ in range(_AT_A_TIME):
        try:
            received = receiver.recvfrom(_LARGEST_DATAGRAM)
        except BlockingIOError:
            return
        except ConnectionError:  # An earlier datagram found nobody; more may wait behind this.
            continue
        yield received


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
