"""Limits on the number of connections and on the time until a request is authenticated.

Connections without an authenticated request share a limited number of slots. When they are full, a
new connection replaces the one that has waited longest, so that they cannot lock out an operator.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import resource
import socket
import ssl
import struct
import time
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import dataclass
from typing import Any, cast

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.typedefs import Handler

from tsd_twin.dashboard.gateway.auth import PRINCIPAL
from tsd_twin.security.rate_limits import subscriber_network

_SWEEP_S = 0.5
_BACKLOG = 1024
_NO_FILES_S = 0.1
_RESET = struct.pack("ii", 1, 0)
"""`SO_LINGER` of zero seconds, so that closing discards unsent data."""
_NOT_HERE = frozenset({errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL})
_PACE_S = 0.001
_GOODBYE_S = 1.0
_FILES = 8192
_FULL = "Too many connections: close some pages, or try again in a moment."
_REFUSAL = (
    "HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 1\r\n"
    f"Content-Type: text/plain; charset=utf-8\r\nContent-Length: {len(_FULL)}\r\n\r\n{_FULL}"
).encode()


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Maximum numbers and timeouts of connections."""

    unauthenticated: int = 128
    """Maximum number of unauthenticated connections."""
    per_address: int = 32
    """Maximum number of unauthenticated connections per address, except the proxy's."""
    per_user: int = 128
    """Maximum number of connections per user over all browsers.

    A page keeps two open, three more for lanes while it has control, and up to eight for pictures.
    """
    handshake_s: float = 5.0
    """Timeout of the TLS handshake."""
    request_s: float = 10.0
    """Timeout of the first request on a connection."""
    idle_s: float = 60.0
    """Timeout of an idle connection between requests."""
    stall_s: float = 20.0
    """Timeout of a client that does not read."""


class _Connection(asyncio.Protocol):
    """TCP connection that forwards its events to the HTTP protocol object."""

    def __init__(
        self, inner: asyncio.Protocol, peer: str, on_lost: Callable[[_Connection], None]
    ) -> None:
        self.peer = peer
        self.user: str | None = None
        """User name, or None before a login."""
        self.busy = False
        """True while a request is being answered, and for websockets."""
        self.known = False
        """True once a request has been authenticated."""
        self.since_s = time.monotonic()
        """Time when it was accepted or its last request was answered."""
        self.handshake: asyncio.Task[Any] | None = None
        self._transport: asyncio.Transport | None = None
        self.exceeds: Callable[[int], bool] | None = None
        """Drops the connection once it returns True for the number of received bytes."""
        self._wrapped = inner
        self._on_lost = on_lost
        self._stalled: tuple[int, float] | None = None

    # Transport callbacks.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        self._wrapped.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        if self.exceeds is not None and self.exceeds(len(data)):
            self.drop()
        else:
            self._wrapped.data_received(data)

    def eof_received(self) -> bool | None:
        return self._wrapped.eof_received()

    def pause_writing(self) -> None:
        self._stalled = (self._unsent(), time.monotonic())
        self._wrapped.pause_writing()

    def resume_writing(self) -> None:
        self._stalled = None
        self._wrapped.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        self._on_lost(self)
        self._wrapped.connection_lost(exc)

    # Timeouts.

    def is_over(self, limits: ConnectionLimits, now_s: float) -> bool:
        """Return whether its timeout has expired."""
        if self._transport is None:
            return False  # asyncio limits the handshake.
        if self._stalled is not None:
            left = self._unsent()
            bytes_, since_s = self._stalled
            if left < bytes_:
                self._stalled = (left, now_s)
            elif now_s - since_s > limits.stall_s:
                return True
        if self.busy or self._unsent() > 0:
            return False
        return now_s - self.since_s > (limits.idle_s if self.known else limits.request_s)

    def drop(self) -> None:
        """Abort the connection, discarding unsent data."""
        if self._transport is not None:
            # Otherwise the kernel would keep data that this client does not read for minutes.
            connection = self._transport.get_extra_info("socket")
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            self._transport.abort()

    def refuse(self) -> None:
        """Close the connection, after an error message if the client can read one."""
        transport = self._transport
        if transport is None:
            if self.handshake is not None:
                self.handshake.cancel()
        elif self.known or self.busy or self._unsent() or transport.get_extra_info("sslcontext"):
            transport.abort()
        else:
            transport.write(_REFUSAL)
            transport.close()

    def _unsent(self) -> int:
        return 0 if self._transport is None else self._transport.get_write_buffer_size()


class ConnectionLimiter:
    """Listening sockets with a limited number of connections in total."""

    def __init__(self, is_proxy: Callable[[str], bool]) -> None:
        """`is_proxy` returns whether an address belongs to the reverse proxy."""
        self._limits = ConnectionLimits()
        self._is_proxy = is_proxy
        self._listeners: list[socket.socket] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._open: dict[_Connection, None] = {}

    async def open(
        self,
        server: Callable[[], asyncio.Protocol],
        host: str,
        port: int,
        tls: ssl.SSLContext | None,
    ) -> int:
        """Listen for connections, and return the port; `server` creates the protocol of each.

        Raises:
            OSError: If the address cannot be used.
        """
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        failure: OSError | None = None
        listeners: list[socket.socket] = []
        for family, address in dict.fromkeys((each[0], each[4]) for each in found):
            try:
                listener = socket.create_server(
                    cast("Any", address), family=family, backlog=_BACKLOG
                )
            except OSError as error:
                failure = error
                if error.errno in _NOT_HERE:
                    continue  # For example, `localhost` without IPv6.
                break
            listener.setblocking(False)
            listeners.append(listener)
        if failure is not None and (failure.errno not in _NOT_HERE or not listeners):
            for listener in listeners:
                listener.close()
            raise failure
        for listener in listeners:
            self._start(self._accept(listener, server, tls))
        if not self._listeners:
            self._start(self._sweep())
        self._listeners += listeners
        return listeners[0].getsockname()[1]

    async def close(self) -> None:
        """Stop listening; existing connections remain open."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for listener in self._listeners:
            listener.close()
        self._listeners.clear()

    @web.middleware
    async def admit(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Count an authenticated request, or refuse it if its user has too many connections."""
        connection = _connection_of(request)
        principal = request.get(PRINCIPAL)
        if principal is not None:
            user = principal.user or ""
            if connection.user != user:
                self._make_room_for(user, connection)
            connection.user = user
        connection.known = True
        connection.busy = True
        try:
            return await handler(request)
        finally:
            connection.busy = False
            connection.since_s = time.monotonic()

    # New connections.

    async def _accept(
        self,
        listener: socket.socket,
        server: Callable[[], asyncio.Protocol],
        tls: ssl.SSLContext | None,
    ) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, address = await loop.sock_accept(listener)
            except OSError:  # Too many open files, or the client has disconnected.
                await asyncio.sleep(_NO_FILES_S)
                continue
            peer = str(address[0])
            scarce = self._make_room(subscriber_network(peer), proxied=self._is_proxy(peer))
            connection = _Connection(server(), subscriber_network(peer), self._forget)
            self._open[connection] = None
            self._start(self._receive(connection, accepted, tls))
            # Pace a flood of connections, because commands have priority.
            await asyncio.sleep(_PACE_S if scarce else 0.0)

    async def _receive(
        self, connection: _Connection, accepted: socket.socket, tls: ssl.SSLContext | None
    ) -> None:
        limits = (
            {}
            if tls is None
            else {
                "ssl_handshake_timeout": self._limits.handshake_s,
                "ssl_shutdown_timeout": _GOODBYE_S,
            }
        )
        connection.handshake = asyncio.current_task()
        try:
            await asyncio.get_running_loop().connect_accepted_socket(
                lambda: connection, accepted, ssl=tls, **limits
            )
        except OSError:  # Also TLS errors and handshake timeouts.
            self._forget(connection)
        except asyncio.CancelledError:
            self._forget(connection)
            accepted.close()
            raise
        finally:
            connection.handshake = None

    def _make_room(self, peer: str, *, proxied: bool) -> bool:
        """Close an unauthenticated connection at a limit; return whether slots are scarce."""
        unauthenticated = [each for each in self._open if each.user is None]
        if not proxied:
            own = [each for each in unauthenticated if each.peer == peer]
            if len(own) >= self._limits.per_address:
                self._drop_oldest(own)
                return True
        if len(unauthenticated) >= self._limits.unauthenticated:
            self._drop_oldest(unauthenticated)
        return 2 * len(unauthenticated) > self._limits.unauthenticated

    def _make_room_for(self, user: str, connection: _Connection) -> None:
        """Close an idle connection of a user to make room for one with a request.

        Raises:
            web.HTTPServiceUnavailable: If no connection is idle.
        """
        own = [each for each in self._open if each.user == user and each is not connection]
        if len(own) < self._limits.per_user:
            return
        idle = [each for each in own if not each.busy]
        if not idle:
            refusal = web.HTTPServiceUnavailable(text=_FULL, headers={"Retry-After": "1"})
            refusal.force_close()
            raise refusal
        self._drop_oldest(idle)

    def _drop_oldest(self, connections: Iterable[_Connection]) -> None:
        """Close the oldest waiting connection, preferably without a request in progress."""
        oldest = min(connections, key=lambda each: (each.busy, each.since_s))
        self._forget(oldest)
        oldest.refuse()

    def _forget(self, connection: _Connection) -> None:
        self._open.pop(connection, None)

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(_SWEEP_S)
            now_s = time.monotonic()
            for connection in [each for each in self._open if each.is_over(self._limits, now_s)]:
                connection.drop()

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def limit_bytes(request: web.Request, exceeds: Callable[[int], bool]) -> None:
    """Drop the connection of a request once `exceeds` returns True for its received bytes.

    Frames that never complete a message, such as endless fragments, do not reach a handler.
    """
    _connection_of(request).exceeds = exceeds


def _connection_of(request: web.Request) -> _Connection:
    """Return the connection of a request.

    Raises:
        ConnectionResetError: If the connection has closed.
    """
    transport = request.transport
    connection = None if transport is None else transport.get_protocol()
    if not isinstance(connection, _Connection):
        raise ConnectionResetError("the connection has gone")
    return connection


def allow_many_files() -> None:
    """Raise this process's open-file limit, because each connection needs several files."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _FILES if hard == resource.RLIM_INFINITY else min(_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def quiet_log() -> logging.Logger:
    """Logger of the HTTP server without tracebacks for malformed requests and lost connections."""
    log = logging.getLogger(__name__)
    log.addFilter(_is_ours)  # Adding the same filter twice has no effect.
    return log


def _is_ours(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    # A browser may disconnect during a response.
    return not isinstance(
        error, (HttpProcessingError, web.RequestPayloadError, ConnectionResetError)
    )
