"""Watchdog that closes half-open Zenoh connections.

Zenoh 1.10 aborts a handshake at its timeout, even if it succeeds at that very moment. It then keeps
a connection on which it sends but never reads, and considers it healthy: the session receives
nothing, and the robot refuses it a second connection (MAX_LINKS) as long as both run. This happens
to a session whose robot pauses for about that timeout.

Zenoh can neither close a single connection nor distinguish such a connection from a healthy one.
The watchdog therefore closes the socket of every connection that took nearly as long as the
timeout. Zenoh reconnects within a second and repeats all declarations, as after any connection
loss. UDP connections share one socket and are left alone.
"""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import socket
import threading
import time
from pathlib import Path

import zenoh

_LOG = logging.getLogger(__name__)

_MARGIN_S = 1.0
"""Maximum duration of the last handshake step on a loaded machine."""
_PAUSE_S = 0.05
_PATIENCE_S = 10.0
"""Zenoh notices a closed socket at its next send, after a quarter of the session timeout."""
_OVER_TCP = ("tcp/", "tls/", "ws/")
_DESCRIPTORS = Path("/proc/self/fd") if Path("/proc/self/fd").is_dir() else Path("/dev/fd")


class HalfOpenConnectionWatchdog:
    """Closes connections whose handshake may have succeeded just as the session gave up.

    Only for sessions that do not listen, so that all their connections are outgoing. Ends with the
    session.
    """

    def __init__(self, session: zenoh.Session, began_s: float, open_timeout_s: float) -> None:
        self._session = session
        self._doubtful_s = open_timeout_s - min(_MARGIN_S, open_timeout_s / 2.0)
        self._lost_s: dict[str, float] = {}
        self._last_lost_s = began_s
        # Call directly, because a handler thread would keep the process from exiting.
        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self._listener = session.info.declare_transport_events_listener(handler, history=True)

    def _take(self, event: zenoh.TransportEvent) -> None:
        """Record an opened or lost connection; runs on a Zenoh thread during the handshake."""
        peer, now_s = str(event.transport.zid), time.monotonic()
        if event.kind == zenoh.SampleKind.DELETE:
            self._lost_s[peer] = self._last_lost_s = now_s
            return
        lost_s = self._lost_s.get(peer)
        # A restarted robot has a different id.
        if now_s - (self._last_lost_s if lost_s is None else lost_s) >= self._doubtful_s:
            thread = threading.Thread(target=self._close_links, args=(peer, lost_s), daemon=True)
            with contextlib.suppress(RuntimeError):  # The process is exiting.
                thread.start()

    def _close_links(self, peer: str, lost_s: float | None) -> None:
        """Close the links to a peer until Zenoh notices, since it may add links to the bad
        connection.
        """
        _LOG.info("the connection to %s took so long that it is opened anew", peer)
        end_s = time.monotonic() + _PATIENCE_S
        while self._lost_s.get(peer) == lost_s and time.monotonic() < end_s:
            if self._session.is_closed():
                return
            for link in self._session.info.links():
                if str(link.zid) == peer and link.src.startswith(_OVER_TCP):
                    _close_socket(link.src, link.dst)
            time.sleep(_PAUSE_S)


def _close_socket(source: str, target: str) -> None:
    """Shut down this process's TCP connection between two endpoints, if it exists."""
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
                    one.shutdown(socket.SHUT_RDWR)


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
