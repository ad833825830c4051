"""Who may come in: every request passes here before anything is answered."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
import time
from collections.abc import Collection, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from aiohttp import web
from aiohttp.typedefs import Handler

from tsd_twin.access import Identity, Logins, Users
from tsd_twin.dashboard.approach import FORWARDED, Approach, approach
from tsd_twin.dashboard.guard import is_loopback, refusal
from tsd_twin.dashboard.visitor import ANYBODY, Visitor, identity_of
from tsd_twin.errors import TwinError

LOGGED_OUT = 4401
"""Why a socket is closed: its login has ended. From 4000 on, codes are for applications."""
_VISITOR = web.RequestKey("_VISITOR", Visitor)
_APPROACH = web.RequestKey("_APPROACH", Approach)
_LOGIN = "/login"
_SWEEP_S = 1.0
_GOODBYE_S = 1.0


@dataclass(frozen=True, slots=True)
class Rules:
    """How a dashboard can be reached, and by whom."""

    owner: Identity = ANYBODY
    """Who the dashboard is on the bus."""
    users: Users | None = None
    """Who may log in; None when nobody has to."""
    tls: ssl.SSLContext | None = None
    proxy: str | None = None
    """Address of the proxy through which all requests come; of the loopback for this machine."""
    allowed_hosts: Collection[str] = ()
    """Values of the `Host` header that are answered, beside those of this machine."""

    def check(self, host: str) -> None:
        """Refuse what would let in everybody, or passwords be read on their way.

        Raises:
            TwinError: so it would.
        """
        if self.users is not None:
            for name in self.users.names:
                identity_of(self.users.user(name), self.owner)
        elif self.proxy is not None or not is_loopback(host):
            what = host if self.proxy is None else "a dashboard behind a proxy"
            raise TwinError(
                f"{what} can be reached by other machines and has no login: name who may come in "
                "with --users FILE, which tsd-users makes"
            )
        proxied = self.proxy is not None and not is_loopback(self.proxy)
        if not (is_loopback(host) or self.tls is not None or proxied):
            raise TwinError(
                f"passwords would cross the network for everybody to read: {host} needs --tls-cert "
                "and --tls-key, or --behind-proxy with the address of one that speaks TLS"
            )


@dataclass(slots=True)
class Door:
    """Knows who is in, and closes the sockets of whoever has to go."""

    rules: Rules
    logins: Logins = field(default_factory=Logins)
    cookie: str = ""
    _port: int = 0
    _addresses: bool = False
    _allowed: frozenset[str] = frozenset()
    _sockets: dict[str, set[web.WebSocketResponse]] = field(
        default_factory=dict[str, set[web.WebSocketResponse]]
    )

    def open(self, host: str, port: int) -> None:
        """Note where the gateway listens."""
        self._port = port
        # Cookies do not tell ports apart: two dashboards of one machine need a name each.
        self.cookie = f"tsd-login-{port}"
        self._addresses = not is_loopback(host)
        names = set(self.rules.allowed_hosts)
        self._allowed = frozenset(names | {f"{name}:{port}" for name in names if ":" not in name})

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Let a request pass, or refuse it; a socket before it is one."""
        headers = {
            name: ", ".join(request.headers.getall(name))  # What comes twice is no host, no origin.
            for name in (*FORWARDED, "Host", "Origin")
            if name in request.headers
        }
        came = approach(
            request.remote or "",
            headers,
            tls=self.rules.tls is not None,
            proxy=self.rules.proxy,
        )
        if isinstance(came, str):
            raise web.HTTPForbidden(text=came)
        reason = refusal(
            headers.get("Host"),
            headers.get("Origin"),
            self._port,
            self._allowed,
            addresses=self._addresses,
            secure=came.secure,
        )
        if reason is not None:
            raise web.HTTPForbidden(text=reason)
        request[_APPROACH] = came
        visitor = self.visitor(request)
        if visitor is not None:
            request[_VISITOR] = visitor
        elif request.path == "/" and request.method == "GET":
            raise web.HTTPFound(_LOGIN[1:])  # Relative: whoever is in front may have a prefix.
        elif request.path != _LOGIN:
            raise web.HTTPUnauthorized(text="Log in first.")
        return await handler(request)

    def visitor(self, request: web.Request) -> Visitor | None:
        """Return who a request comes from; None when they have to log in."""
        owner = self.rules.owner
        if self.rules.users is None:
            return Visitor(owner, may_stop=True)
        login = self.logins.find(request.cookies.get(self.cookie), time.monotonic())
        if login is None:
            return None
        return Visitor(identity_of(login.user, owner), login.user.may_stop, login)

    @contextmanager
    def holding(self, visitor: Visitor, socket: web.WebSocketResponse) -> Generator[None]:
        """Close a socket when its visitor's login ends, within this context."""
        if visitor.key is None:
            yield
            return
        sockets = self._sockets.setdefault(visitor.key, set())
        sockets.add(socket)
        try:
            yield
        finally:
            sockets.discard(socket)
            if not sockets and self._sockets.get(visitor.key) is sockets:
                del self._sockets[visitor.key]

    async def end(self, login_id: str) -> None:
        """End a login and close all that it has open: a robot that it drives comes to rest."""
        self.logins.close(login_id)
        await asyncio.gather(*(_close(socket) for socket in self._sockets.get(login_id, ())))

    async def watch(self) -> None:
        """End, once a second, the logins whose time is over; ends by cancellation."""
        while True:
            await asyncio.sleep(_SWEEP_S)
            self.logins.sweep(set(self._sockets), time.monotonic())
            for login_id in list(self._sockets):
                if not self.logins.is_open(login_id):
                    await self.end(login_id)


def visitor_of(request: web.Request) -> Visitor:
    """Return who a request comes from that the door has let pass."""
    return request[_VISITOR]


def visitor_or_none(request: web.Request) -> Visitor | None:
    """Return who a request comes from; None when they have to log in."""
    return request.get(_VISITOR)


def approach_of(request: web.Request) -> Approach:
    """Return how a request came that the door has let pass."""
    return request[_APPROACH]


async def _close(socket: web.WebSocketResponse) -> None:
    with contextlib.suppress(TimeoutError, ConnectionError):
        async with asyncio.timeout(_GOODBYE_S):
            await socket.close(code=LOGGED_OUT, message=b"logged out")
