"""HTTP server of the dashboard: routes, sockets, static files and TLS."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, cast

from aiohttp import web

from tsd_twin.dashboard.gateway.auth import (
    HEADERS,
    LOGIN_PATH,
    PRINCIPAL,
    AccessSettings,
    AuthMiddleware,
    is_proxy,
)
from tsd_twin.dashboard.gateway.connection_limits import ConnectionLimiter, quiet_log
from tsd_twin.dashboard.gateway.listener import LISTENER, Listener
from tsd_twin.dashboard.gateway.login import LoginRoutes
from tsd_twin.dashboard.gateway.pages import BundlePage, ViewportPage
from tsd_twin.dashboard.gateway.pictures import PictureRoutes
from tsd_twin.dashboard.gateway.portraits import PortraitRoutes
from tsd_twin.dashboard.gateway.recordings import RecordingRoutes, json_response
from tsd_twin.dashboard.gateway.socket_limits import TELEOP, SocketReader
from tsd_twin.dashboard.gateway.viewport import PAGE_ID, ViserProxy
from tsd_twin.dashboard.pictures.feed import Cameras
from tsd_twin.dashboard.recorded.pages import RecordedPages
from tsd_twin.dashboard.sessions.page_session import PageSocket
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.dashboard.wire.pictures import CamerasChanged
from tsd_twin.dashboard.wire.to_page import RecordingsChanged
from tsd_twin.errors import TwinError
from tsd_twin.security.web_access import host_of_origin, name_of_host

_MAX_BODY_BYTES = 2048
_MAX_MESSAGE_BYTES = 16 * 2**10
"""The longest message of a page is a drawn line; all others have fewer than 200 bytes."""
_HEARTBEAT_S = 5.0
_CLOSE_TIMEOUT_S = 0.5
_SHUTDOWN_TIMEOUT_S = 3.0
_LAST_PORT = 65_535
_LINGER_S = 2.0
"""Timeout for reading the rest of a request body after the response."""


class HttpServer:
    """HTTP server on an asyncio event loop."""

    def __init__(
        self,
        sessions: SessionManager,
        viser_port: int,
        *,
        auth: AuthMiddleware | None = None,
        recorded: RecordedPages | None = None,
        cameras: Cameras | None = None,
    ) -> None:
        """Load the pages; `recorded` serves the pages that show recordings, `cameras` pictures.

        Without `auth`, all requests from this machine are accepted, and no others.

        Raises:
            TwinError: If a page cannot be used.
        """
        self.sessions = sessions
        """Sessions of the open pages."""
        self._main = Listener(("/",), LOGIN_PATH)
        self._viewport = Listener()
        self._page = BundlePage()
        self._viewport_page = ViewportPage(self._main)
        self._auth = AuthMiddleware(AccessSettings()) if auth is None else auth
        self._login_routes = LoginRoutes(self._auth)
        self._reader = SocketReader()
        self._proxy = ViserProxy(viser_port, self._reader)
        self._connection_limiter = ConnectionLimiter(
            lambda peer: is_proxy(peer, self._auth.rules.proxy)
        )
        self._recorded = recorded
        self._recordings = None if recorded is None else RecordingRoutes(recorded.library)
        self._pictures = (
            None
            if cameras is None
            else PictureRoutes(cameras, self._reader, self._auth.close_on_logout)
        )
        self._runners: list[web.AppRunner] = []
        self._background_tasks: list[asyncio.Task[None]] = []
        self.port = 0
        """Port of the server, once started."""
        self.viewport_port = 0
        """Port of the viewport, once started; 0 if it has none."""

    async def start(
        self, host: str = "127.0.0.1", port: int = 8080, viewport_port: int | None = None
    ) -> None:
        """Start listening; port 0 selects a free port.

        `viewport_port` defaults to the next port, or any free one if `port` is 0 or the next one
        is in use. A viewport behind a proxy has a port only if its origin is known.

        Raises:
            TwinError: If a port is in use, or the settings allow network access without a login
                or without encryption.
        """
        rules = self._auth.rules
        rules.check(host)
        has_port = rules.proxy is None or rules.viewport_origin is not None
        if viewport_port is not None and not has_port:
            raise TwinError("--viewport-port behind a proxy needs --viewport-origin")
        self.sessions.open()
        try:
            self.port = await self._listen(self._make_app(), host, port)
            self._auth.open(self._main, host, self.port)
            if has_port:
                await self._open_viewport(host, port, viewport_port)
        except TwinError:
            await self._close_listeners()
            raise
        self._page.set_viewport(self.viewport_port, rules.viewport_origin)
        sessions = self.sessions
        measuring = sessions.directory.measure_round_trips()
        watching = [measuring, self._auth.expire_logins()]
        if self._recorded is not None:
            self._recorded.library.on_changed = self._announce_recordings
            watching.append(self._recorded.library.watch())
        if self._pictures is not None:
            self._pictures.cameras.on_changed = lambda: sessions.send_to_all(CamerasChanged())
        self._background_tasks = [asyncio.create_task(work) for work in watching]

    def _make_app(self) -> web.Application:
        app = self._make_application(self._main)
        self._page.add_to(app.router)
        PortraitRoutes(self.sessions.directory.links).add_to(app.router)
        app.router.add_get("/healthz", self._serve_health)
        app.router.add_get("/teleop", self._serve_page_socket)
        app.router.add_get("/teleop/lane", self._serve_lane)
        if self._pictures is not None:
            app.router.add_get("/cameras", self._pictures.serve_list)
            app.router.add_get("/pictures", self._serve_pictures)
        if self._recordings is None:
            app.router.add_get("/recordings", _serve_no_recordings)
        else:
            self._recordings.add_to(app.router)
        self._login_routes.add_to(app.router)
        return app

    def _make_application(self, listener: Listener) -> web.Application:
        """Return an application with the routes of viser's page, which both ports have."""
        app = web.Application(
            middlewares=[self._auth.authenticate, self._connection_limiter.admit],
            client_max_size=_MAX_BODY_BYTES,
        )
        app[LISTENER] = listener
        app.on_response_prepare.append(_add_headers)
        self._viewport_page.add_to(app.router)
        app.router.add_get("/viser/{page}", self._serve_viser)
        if self._recorded is not None:
            app.router.add_get("/recorded/{name}/{page}", self._serve_viser)
        return app

    async def _open_viewport(self, host: str, main_port: int, port: int | None) -> None:
        following = main_port + 1 if 0 < main_port < _LAST_PORT else 0
        app = self._make_application(self._viewport)
        try:
            opened = await self._listen(app, host, following if port is None else port)
        except TwinError:
            if port is not None:
                raise
            opened = await self._listen(self._make_application(self._viewport), host, 0)
        self.viewport_port = opened
        rules = self._auth.rules
        known = {name_of_host(each) for each in rules.allowed_hosts}
        if rules.viewport_origin is not None:
            known = {host_of_origin(rules.viewport_origin) or ""}
        self._viewport.open(host, opened, known)

    async def _listen(self, app: web.Application, host: str, port: int) -> int:
        """Serve `app` and return the port.

        Raises:
            TwinError: If the port cannot be used.
        """
        runner = web.AppRunner(
            app,
            access_log=None,
            logger=quiet_log(),
            lingering_time=_LINGER_S,
            shutdown_timeout=_SHUTDOWN_TIMEOUT_S,
        )
        await runner.setup()
        server = cast("Callable[[], asyncio.Protocol]", runner.server)
        try:
            opened = await self._connection_limiter.open(server, host, port, self._auth.rules.tls)
        except OSError as error:
            await runner.cleanup()
            raise TwinError(f"port {port} of {host} cannot be used: choose another") from error
        self._runners.append(runner)
        return opened

    async def _close_listeners(self) -> None:
        await self._connection_limiter.close()
        await asyncio.gather(*(runner.cleanup() for runner in self._runners))
        self._runners.clear()

    async def stop(self) -> None:
        """Release all robots, close all sockets and stop listening."""
        if not self._runners:
            return
        for task in self._background_tasks:
            task.cancel()
        await self.sessions.close_sockets()
        await self._proxy.close()
        if self._pictures is not None:
            await self._pictures.close()
        if self._recorded is not None and self._recordings is not None:
            self._recordings.close()
            await self._recorded.close()
        await self._close_listeners()
        self.sessions.close()
        self._login_routes.close()

    async def _serve_health(self, request: web.Request) -> web.StreamResponse:
        directory, rights = self.sessions.directory, request[PRINCIPAL].rights
        robots = {each: row for each, row in directory.health().items() if rights.may_watch(each)}
        refused = {
            "messages": self.sessions.rejected,
            "viser": self._proxy.dropped,
            "beyond_limits": self._reader.dropped,
            "cut_off": self._reader.cut_off.count,
        }
        return json_response(
            {"ready": directory.has_live_robot(rights), "robots": robots, "refused": refused}
        )

    def _announce_recordings(self) -> None:
        assert self._recorded is not None  # noqa: S101  Its library calls this.
        message = RecordingsChanged()
        self.sessions.send_to_all(message)
        self._recorded.send_to_all(message)

    async def _serve_viser(self, request: web.Request) -> web.StreamResponse:
        page = await self._admit(request, request.match_info["page"])
        name, principal = request.match_info.get("name"), request[PRINCIPAL]
        holding = partial(self._auth.close_on_logout, principal)
        if name is None:
            return await self._proxy.serve(request, page, principal, holding)
        assert self._recorded is not None  # noqa: S101  Or there is no such route.
        async with self._recorded.view(page, name, principal) as view:
            return await self._proxy.serve(request, page, principal, holding, port=view.viser_port)

    async def _serve_page_socket(self, request: web.Request) -> web.StreamResponse:
        page = await self._admit(request, request.query.get("page", ""))
        recording = request.query.get("recording")
        if recording is None:
            return await self._run_page(request, page, self.sessions.run_session)
        if self._recorded is None:
            raise web.HTTPNotFound(text="This dashboard shows no recordings.")
        async with self._recorded.view(page, recording, request[PRINCIPAL]) as view:
            return await self._run_page(request, page, partial(self._recorded.run_session, view))

    async def _serve_lane(self, request: web.Request) -> web.StreamResponse:
        page = await self._admit(request, request.query.get("page", ""))
        if not self.sessions.accepts_lane(page):
            raise web.HTTPConflict(text="The page is not open, or has all its lanes.")
        return await self._run_page(request, page, self.sessions.run_lane)

    async def _serve_pictures(self, request: web.Request) -> web.StreamResponse:
        assert self._pictures is not None  # noqa: S101  Or there is no such route.
        page = await self._admit(request, request.query.get("page", ""))
        return await self._pictures.serve(request, page, request[PRINCIPAL])

    async def _run_page(
        self,
        request: web.Request,
        page: str,
        run: Callable[[PageSocket], Coroutine[Any, Any, None]],
    ) -> web.StreamResponse:
        principal = request[PRINCIPAL]
        socket = web.WebSocketResponse(
            timeout=_CLOSE_TIMEOUT_S,
            compress=False,
            max_msg_size=_MAX_MESSAGE_BYTES,
            heartbeat=_HEARTBEAT_S,
            autoping=False,
        )
        await socket.prepare(request)
        messages = self._reader.messages(request, socket, TELEOP, principal.key or page)
        holding = self._auth.close_on_logout(principal, socket)
        name = request.query.get("name", "")
        await run(PageSocket(page, principal, socket, messages, holding, name))
        await self._reader.close_cut_off(request, socket)
        return socket

    async def _admit(self, request: web.Request, page: str) -> str:
        """Return the page id of a socket; refuse an invalid id, another login's page or a flood."""
        if not PAGE_ID.fullmatch(page):
            raise web.HTTPBadRequest(text="A page id is 16 hex digits.")
        owner, key = self.sessions.principal_of(page), request[PRINCIPAL].key
        if owner is not None and owner.key != key:
            raise web.HTTPForbidden(text="This page belongs to another login.")
        await self._reader.admit(request, key or page)
        return page


async def _serve_no_recordings(_request: web.Request) -> web.StreamResponse:
    """Answer `GET recordings` with 204, so that the page has no timeline."""
    return web.Response(status=204, headers={"Cache-Control": "no-store"})


async def _add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    if "Content-Security-Policy" not in response.headers:  # The login page has a stricter policy.
        response.headers.update(HEADERS)
