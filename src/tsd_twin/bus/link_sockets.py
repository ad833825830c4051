"""Sockets of Zenoh's links, which Zenoh itself does not expose."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
import struct
from collections.abc import Generator
from pathlib import Path

import zenoh

OVER_TCP = ("tcp/", "tls/", "ws/")
_DESCRIPTORS = Path("/proc/self/fd") if Path("/proc/self/fd").is_dir() else Path("/dev/fd")
_NO_LINGER = struct.pack("ii", 0, 0)


def close_at_once(session: zenoh.Session) -> object:
    """Let the sockets of a session's links close without delay, while the returned object exists.

    Zenoh 1.10 closes them with `SO_LINGER` of 10 s. If a peer has stopped and its socket is full, a
    thread that receives would wait for 10 s, and with it all other links that it serves: one
    stopped viewer would cut off all robots of a router.
    """

    def take(event: zenoh.LinkEvent) -> None:
        link = event.link
        if event.kind == zenoh.SampleKind.PUT and link.src.startswith(OVER_TCP):
            for one in sockets_between(link.src, link.dst):
                one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)

    # Call directly, because a handler thread would keep the process from exiting.
    handler = zenoh.handlers.Callback(take, indirect=False)
    return session.info.declare_link_events_listener(handler, history=True)


def sockets_between(source: str, target: str) -> Generator[socket.socket]:
    """Yield this process's TCP sockets between two endpoints, at most one, as a copy."""
    ends = _address(source), _address(target)
    for file in _DESCRIPTORS.iterdir():
        with contextlib.suppress(OSError):
            # Use a copy: the original descriptor number may be reused at any time.
            copy = os.dup(int(file.name))
            try:
                one = socket.socket(fileno=copy)
            except OSError:  # Not a socket.
                os.close(copy)
                continue
            with one:
                if one.family in (socket.AF_INET, socket.AF_INET6) and ends == (
                    _normal(one.getsockname()),
                    _normal(one.getpeername()),
                ):
                    yield one


def _address(endpoint: str) -> tuple[str, int]:
    """Return address and port of an endpoint such as `tcp/127.0.0.1:7447`."""
    host, _, port = endpoint.partition("/")[2].split("?")[0].split("#")[0].rpartition(":")
    return _normal((host.strip("[]"), int(port)))


def _normal(name: tuple[str, int] | tuple[str, int, int, int]) -> tuple[str, int]:
    """Return address and port of a socket name, with IPv4-mapped IPv6 as IPv4."""
    address = ipaddress.ip_address(name[0].partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address):
        address = address.ipv4_mapped or address
    return str(address), name[1]
