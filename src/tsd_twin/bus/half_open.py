"""Watchdog that closes half-open Zenoh connections.

Zenoh 1.10 aborts a handshake at its timeout, even if it succeeds at that very moment. It then keeps
a connection on which it sends but never reads, and considers it healthy: the session receives
nothing, and the robot refuses it a second connection (MAX_LINKS) as long as both run. This happens
to a session whose robot pauses for about that timeout.

Zenoh can neither close a single connection nor distinguish such a connection from a healthy one.
The watchdog therefore closes the socket of every connection whose handshake lasted nearly as long
as the timeout, half a second after it opened. Zenoh reconnects within a second and repeats all
declarations, as after any connection loss. UDP connections share one socket and are left alone.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
import time

import zenoh

from tsd_twin.bus.link_sockets import OVER_TCP, sockets_between

_LOG = logging.getLogger(__name__)

_MARGIN_S = 1.0
"""Maximum duration of the last handshake step on a loaded machine."""
_SETTLE_S = 0.5
"""Age at which a doubtful connection is closed."""
_PAUSE_S = 0.05
_PATIENCE_S = 10.0
"""Zenoh notices a closed socket at its next send, after a quarter of the session timeout."""


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
        # A robot that was suspended is still removing the previous session and adding this one. If
        # the link closes too early, the next session may be connected but receive nothing.
        time.sleep(_SETTLE_S)
        _LOG.info("the connection to %s took so long that it is opened anew", peer)
        end_s = time.monotonic() + _PATIENCE_S
        while self._lost_s.get(peer) == lost_s and time.monotonic() < end_s:
            if self._session.is_closed():
                return
            for link in self._session.info.links():
                if str(link.zid) == peer and link.src.startswith(OVER_TCP):
                    for one in sockets_between(link.src, link.dst):
                        one.shutdown(socket.SHUT_RDWR)
            time.sleep(_PAUSE_S)
