"""Authentication and request checks: hosts, origins, proxies and logins."""

from __future__ import annotations

import asyncio
import contextlib
import re
import ssl
import time
from collections.abc import Callable, Collection, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from aiohttp import web
from aiohttp.typedefs import Handler

from tsd_twin.dashboard.gateway.listener import LISTENER, Listener, check_viewport_origin
from tsd_twin.dashboard.sessions.principal import DEFAULT_IDENTITY, Principal, bus_identity_of
from tsd_twin.errors import TwinError
from tsd_twin.security import BusIdentity
from tsd_twin.security.rate_limits import parse_address, subscriber_network
from tsd_twin.security.router_rules import ALL
from tsd_twin.security.users import Logins, Users
from tsd_twin.security.web_access import is_loopback

CONTENT_SOURCES = {
    "default-src": "'self'",
    # viser unpacks its client in the page itself, compiles WebAssembly and starts workers from
    # blobs; its Plotly widget needs eval.
    "script-src": "'self' 'unsafe-inline' 'unsafe-eval' blob: data:",
    "worker-src": "blob: data:",
    "connect-src": "'self' data: blob:",
    "style-src": "'self' 'unsafe-inline'",
    "img-src": "'self' data: blob:",
    "font-src": "'self' data:",
    "object-src": "'none'",
    "base-uri": "'none'",
    "form-action": "'none'",
    "frame-ancestors": "'none'",
}
"""Content security policy of viser's pages."""


def policy_of(sources: Mapping[str, str]) -> str:
    """Return the value of the header `Content-Security-Policy`."""
    return "; ".join(f"{key} {value}" for key, value in sources.items())


HEADERS = {
    "Content-Security-Policy": policy_of(CONTENT_SOURCES),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    # Gives each of the two ports a separate process of the browser.
    "Origin-Agent-Cluster": "?1",
    "Server": "tsd-twin",
}
"""Headers of every response. Framing is forbidden because a framed page can be used for
clickjacking.
"""


FORWARDING_HEADERS = ("X-Forwarded-For", "X-Forwarded-Proto", "X-Forwarded-Prefix")
"""Forwarding headers set by a reverse proxy."""
_PREFIX = re.compile(r"(/[A-Za-z0-9._~-]+)*")


@dataclass(frozen=True, slots=True)
class ClientAddress:
    """Address, transport security and path of a request as the browser sees them."""

    address: str
    """Rate-limit key for logins: the IPv4 address or the IPv6 /64 network."""
    secure: bool
    """Whether the request used TLS."""
    path: str
    """Path of the dashboard's pages as the browser sees it, used for the login cookie."""


def resolve_client_address(
    peer: str, headers: Mapping[str, str], *, tls: bool, proxy: str | None
) -> ClientAddress | str:
    """Return the client address of a request, or the reason for refusing it.

    Forwarding headers are used only if the TCP peer `peer` is the configured reverse proxy at
    address `proxy`, because any client can forge them. `headers` contains each header once, with
    repeated values joined by commas.
    """
    if proxy is None:
        return ClientAddress(subscriber_network(peer), tls, "/")
    if not is_proxy(peer, proxy):
        return "Requests come through the proxy in front of this gateway."
    if headers.get("X-Forwarded-Proto") != "https":
        return "The proxy has to speak TLS to browsers and to say so: X-Forwarded-Proto: https."
    # Each proxy appends the address that it saw, some of them as an additional header. A browser
    # can forge everything before that.
    seen = headers.get("X-Forwarded-For", peer).rpartition(",")[2].strip()
    prefix = headers.get("X-Forwarded-Prefix", "").rstrip("/")
    path = prefix if prefix and _PREFIX.fullmatch(prefix) else "/"
    return ClientAddress(subscriber_network(seen), secure=True, path=path)


def is_proxy(peer: str, proxy: str | None) -> bool:
    """Return whether a peer is the proxy, or might be, because it is on the dashboard's machine."""
    if proxy is None:
        return False
    if is_loopback(peer):
        return True
    try:
        return parse_address(peer) == parse_address(proxy)
    except ValueError:
        return False


LOGGED_OUT_CODE = 4401
"""Close code of a socket whose login has ended; codes from 4000 are for applications."""
PRINCIPAL = web.RequestKey("PRINCIPAL", Principal)
"""Principal of a request, missing before a login."""
CLIENT_ADDRESS = web.RequestKey("CLIENT_ADDRESS", ClientAddress)
"""Client address of a request."""
LOGIN_PATH = "/login"
_EXPIRY_CHECK_S = 1.0
_CLOSE_TIMEOUT_S = 1.0


@dataclass(frozen=True, slots=True)
class AccessSettings:
    """Access settings: users, TLS, proxy and allowed hosts."""

    owner: BusIdentity = DEFAULT_IDENTITY
    """Identity of the dashboard on the bus."""
    users: Users | None = None
    """Users who may log in; None if no login is required."""
    tls: ssl.SSLContext | None = None
    proxy: str | None = None
    """Address of the proxy that forwards all requests; a loopback address for this machine."""
    allowed_hosts: Collection[str] = ()
    """Accepted values of the `Host` header in addition to this machine's names."""
    viewport_origin: str | None = None
    """Origin of the viewport's port as browsers see it; None if it has the page's name."""

    @property
    def limits_robots(self) -> bool:
        """Whether a user may not watch all robots."""
        users = self.users
        return users is not None and any(
            ALL not in users.user(name).rights.visible for name in users.names
        )

    def check(self, host: str) -> None:
        """Check the settings for unauthenticated network access and unencrypted passwords.

        Raises:
            TwinError: If the settings are unsafe.
        """
        check_viewport_origin(self.viewport_origin, self.allowed_hosts)
        if self.users is not None:
            for name in self.users.names:
                bus_identity_of(self.users.user(name), self.owner)
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
class AuthMiddleware:
    """Middleware that checks each request and closes the sockets of ended logins."""

    rules: AccessSettings
    logins: Logins = field(default_factory=Logins)
    cookie: str = ""
    now_s: Callable[[], float] = time.monotonic
    """Clock of the logins, s."""
    _sockets: dict[str, set[web.WebSocketResponse]] = field(
        default_factory=dict[str, set[web.WebSocketResponse]]
    )

    def open(self, listener: Listener, host: str, port: int) -> None:
        """Set the address of the main port."""
        # Browsers share cookies between ports, so each dashboard on a machine needs its own cookie
        # name.
        self.cookie = f"tsd-login-{port}"
        listener.open(host, port, self.rules.allowed_hosts)

    @web.middleware
    async def authenticate(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Check a request before its handler runs or its socket is upgraded."""
        headers = {
            name: ", ".join(request.headers.getall(name))  # Invalid if repeated.
            for name in (*FORWARDING_HEADERS, "Host", "Origin")
            if name in request.headers
        }
        client = resolve_client_address(
            request.remote or "",
            headers,
            tls=self.rules.tls is not None,
            proxy=self.rules.proxy,
        )
        if isinstance(client, str):
            raise web.HTTPForbidden(text=client)
        listener = request.app[LISTENER]
        reason = listener.refusal(headers.get("Host"), headers.get("Origin"), secure=client.secure)
        if reason is not None:
            raise web.HTTPForbidden(text=reason)
        request[CLIENT_ADDRESS] = client
        principal = self.principal_of_request(request)
        if principal is not None:
            request[PRINCIPAL] = principal
        elif request.path in listener.login_redirects and request.method == "GET":
            # Relative, because a proxy may add a prefix.
            raise web.HTTPFound("../" * (request.path.count("/") - 1) + LOGIN_PATH[1:])
        elif request.path != listener.login_path:
            raise web.HTTPUnauthorized(text="Log in first.")
        return await handler(request)

    def principal_of_request(self, request: web.Request) -> Principal | None:
        """Return the principal of a request, or None if a login is required."""
        owner = self.rules.owner
        if self.rules.users is None:
            return Principal(owner, may_stop=True)
        login = self.logins.find(request.cookies.get(self.cookie), self.now_s())
        if login is None:
            return None
        user = login.user
        return Principal(bus_identity_of(user, owner), user.may_stop, login, user.rights)

    @contextmanager
    def close_on_logout(
        self, principal: Principal, socket: web.WebSocketResponse
    ) -> Generator[None]:
        """Context in which a socket is closed when its login ends."""
        if principal.key is None:
            yield
            return
        sockets = self._sockets.setdefault(principal.key, set())
        sockets.add(socket)
        try:
            yield
        finally:
            sockets.discard(socket)
            if not sockets and self._sockets.get(principal.key) is sockets:
                del self._sockets[principal.key]

    async def end_login(self, login_id: str) -> None:
        """End a login and close its sockets, so that a robot driven through them stops."""
        self.logins.close(login_id)
        await asyncio.gather(*(_close_socket(socket) for socket in self._sockets.get(login_id, ())))

    async def expire_logins(self) -> None:
        """Check for expired login sessions once a second; runs until cancelled."""
        while True:
            await asyncio.sleep(_EXPIRY_CHECK_S)
            self.logins.sweep(set(self._sockets), self.now_s())
            for login_id in list(self._sockets):
                if not self.logins.is_open(login_id):
                    await self.end_login(login_id)


def require_origin(request: web.Request) -> None:
    """Refuse a change without an `Origin` header; the middleware has refused foreign origins."""
    if "Origin" not in request.headers:
        raise web.HTTPForbidden(text="A change says where it comes from: send Origin.")


async def _close_socket(socket: web.WebSocketResponse) -> None:
    with contextlib.suppress(TimeoutError, ConnectionError):
        async with asyncio.timeout(_CLOSE_TIMEOUT_S):
            await socket.close(code=LOGGED_OUT_CODE, message=b"logged out")
