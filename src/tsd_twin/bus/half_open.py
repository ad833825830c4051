"""Watch over the connections of a session: it closes those that Zenoh may have opened by half.

Zenoh 1.10 gives up a handshake when its timeout ends, also in the moment in which it succeeds. Then
it keeps a connection on which it sends but never reads, and takes it for a good one: the session
hears nothing, and the robot refuses it a second connection (MAX_LINKS), for as long as both run.
This happens to a session whose robot stops for as long as that timeout.

Zenoh has no call that closes one connection, nor does it tell such a connection from a good one. So
every connection that took nearly as long as the timeout is closed below Zenoh, at its socket. Zenoh
opens the next one within a second, and declares everything anew, as after any loss of the link.
Connections over UDP have no socket of their own and are left alone.
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
"""How long the last step of a handshake takes at most, on a loaded machine."""
_PAUSE_S = 0.05
_PATIENCE_S = 10.0
"""Zenoh notices a closed socket when it next sends: after a quarter of the session timeout."""
_OVER_TCP = ("tcp/", "tls/", "ws/")
_DESCRIPTORS = Path("/proc/self/fd") if Path("/proc/self/fd").is_dir() else Path("/dev/fd")


class HalfOpenWatch:
    """Closes connections that a session has opened in the moment in which it may have given up.

    For sessions that listen nowhere: their connections are all their own. It ends with the session.
    """

    def __init__(self, session: zenoh.Session, began_s: float, open_timeout_s: float) -> None:
        self._session = session
        self._doubtful_s = open_timeout_s - min(_MARGIN_S, open_timeout_s / 2.0)
        self._lost_s: dict[str, float] = {}
        self._last_lost_s = began_s
        # Direct, without a thread of its own: it would keep a process from ending.
        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self._listener = session.info.declare_transport_events_listener(handler, history=True)

    def _take(self, event: zenoh.TransportEvent) -> None:
        """Note a connection that was opened or lost; on a thread of Zenoh, in the handshake."""
        peer, now_s = str(event.transport.zid), time.monotonic()
        if event.kind == zenoh.SampleKind.DELETE:
            self._lost_s[peer] = self._last_lost_s = now_s
            return
        lost_s = self._lost_s.get(peer)
        # A robot that was started again has another id.
        if now_s - (self._last_lost_s if lost_s is None else lost_s) >= self._doubtful_s:
            thread = threading.Thread(target=self._close_links, args=(peer, lost_s), daemon=True)
            with contextlib.suppress(RuntimeError):  # The process ends.
                thread.start()

    def _close_links(self, peer: str, lost_s: float | None) -> None:
        """Close the links to a peer until Zenoh has noticed.

        It may add a new link to the bad connection before.
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
    """Shut down the TCP connection of this process between two endpoints, if there is one."""
    ends = _address(source), _address(target)
    for file in _DESCRIPTORS.iterdir():
        with contextlib.suppress(OSError):
            # Of a copy: what the number stands for may change, what the copy stands for does not.
            copy = os.dup(int(file.name))
            try:
                one = socket.socket(fileno=copy)
            except OSError:  # It is no socket.
                os.close(copy)
                continue
            with one:
                if one.family in (socket.AF_INET, socket.AF_INET6) and ends == (
                    _normal(one.getsockname()),
                    _normal(one.getpeername()),
                ):
                    one.shutdown(socket.SHUT_RDWR)


def _address(endpoint: str) -> tuple[str, int]:
    """Address and port of an endpoint such as `tcp/127.0.0.1:7447`."""
    host, _, port = endpoint.partition("/")[2].split("?")[0].split("#")[0].rpartition(":")
    return _normal((host.strip("[]"), int(port)))


def _normal(name: tuple[str, int] | tuple[str, int, int, int]) -> tuple[str, int]:
    """Address and port of the name of a socket; IPv4 in IPv6 counts as IPv4."""
    address = ipaddress.ip_address(name[0].partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address):
        address = address.ipv4_mapped or address
    return str(address), name[1]
