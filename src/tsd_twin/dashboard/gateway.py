"""What the operator's browser speaks to: viser's page with our controls, and their socket."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import cast

import msgspec
from aiohttp import web

from tsd_twin.dashboard.allowance import TELEOP
from tsd_twin.dashboard.approach import is_proxy
from tsd_twin.dashboard.audience import Audience
from tsd_twin.dashboard.door import Door, Rules, visitor_of
from tsd_twin.dashboard.ear import Ear
from tsd_twin.dashboard.entrance import Entrance, quiet_log
from tsd_twin.dashboard.guard import HEADERS
from tsd_twin.dashboard.pages import STATIC, IndexPage
from tsd_twin.dashboard.proxy import PAGE, ViserProxy
from tsd_twin.dashboard.reception import Reception
from tsd_twin.errors import TwinError

_BODY_BYTES = 2048
_MESSAGE_BYTES = 16 * 2**10
"""The longest message of a page is a line that was drawn; all others have fewer than 200."""
_HEARTBEAT_S = 5.0
_GOODBYE_S = 0.5
_PATIENCE_S = 3.0
_LINGER_S = 2.0
"""How long the rest of a body is read that comes after the answer to it."""


class Gateway:
    """One HTTP server on one event loop."""

    def __init__(self, audience: Audience, viser_port: int, *, door: Door | None = None) -> None:
        """Read viser's page.

        `audience` is who opens it. `door` decides who may come in; without one everybody may, from
        this machine.

        Raises:
            TwinError: viser's page cannot be used.
        """
        self.audience = audience
        """The pages that are open."""
        self._index = IndexPage()
        self._door = Door(Rules()) if door is None else door
        self._reception = Reception(self._door)
        self._ear = Ear()
        self._proxy = ViserProxy(viser_port, self._ear)
        self._entrance = Entrance(lambda peer: is_proxy(peer, self._door.rules.proxy))
        self._runner: web.AppRunner | None = None
        self._watching: list[asyncio.Task[None]] = []
        self.port = 0
        """Where the gateway listens, once it has been started."""

    async def start(self, host: str = "127.0.0.1", port: int = 8080) -> None:
        """Listen; port 0 takes a free one.

        Raises:
            TwinError: the port is in use, or others could come in, or read what is said.
        """
        self._door.rules.check(host)
        self.audience.open()
        app = web.Application(
            middlewares=[self._door.guard, self._entrance.admit], client_max_size=_BODY_BYTES
        )
        app.on_response_prepare.append(_add_headers)
        app.router.add_get("/", self._index.serve)
        app.router.add_get("/healthz", self._serve_health)
        app.router.add_get("/teleop", self._serve_teleop)
        app.router.add_get("/viser/{page}", self._serve_viser)
        self._reception.add_to(app.router)
        app.router.add_static("/static", STATIC)
        runner = web.AppRunner(
            app,
            access_log=None,
            logger=quiet_log(),
            lingering_time=_LINGER_S,
            shutdown_timeout=_PATIENCE_S,
        )
        await runner.setup()
        server = cast("Callable[[], asyncio.Protocol]", runner.server)
        try:
            await self._entrance.open(server, host, port, self._door.rules.tls)
        except OSError as error:
            await runner.cleanup()
            raise TwinError(f"port {port} of {host} cannot be used: choose another") from error
        self.port = self._entrance.port
        self._door.open(host, self.port)
        self._runner = runner
        watching = (self.audience.roster.measure(), self._door.watch())
        self._watching = [asyncio.create_task(work) for work in watching]

    async def stop(self) -> None:
        """Let go of all robots, close all sockets, and listen no more."""
        if self._runner is None:
            return
        for task in self._watching:
            task.cancel()
        await self.audience.dismiss()
        await self._proxy.close()
        await self._entrance.close()
        await self._runner.cleanup()
        self._runner = None
        self.audience.close()
        self._reception.close()

    async def _serve_health(self, request: web.Request) -> web.StreamResponse:
        del request
        roster = self.audience.roster
        refused = {
            "messages": self.audience.rejected,
            "viser": self._proxy.dropped,
            "beyond_limits": self._ear.dropped,
            "cut_off": self._ear.cut_off.count,
        }
        body = msgspec.json.encode(
            {"ready": roster.sees_a_robot(), "robots": roster.health(), "refused": refused}
        )
        return web.Response(
            body=body, content_type="application/json", headers={"Cache-Control": "no-store"}
        )

    async def _serve_viser(self, request: web.Request) -> web.StreamResponse:
        page, visitor = self._page_of(request, request.match_info["page"]), visitor_of(request)
        await self._ear.admit(request, visitor.key or page)
        return await self._proxy.serve(
            request, page, visitor, lambda socket: self._door.holding(visitor, socket)
        )

    async def _serve_teleop(self, request: web.Request) -> web.StreamResponse:
        page, visitor = self._page_of(request, request.query.get("page", "")), visitor_of(request)
        key = visitor.key or page
        await self._ear.admit(request, key)
        socket = web.WebSocketResponse(
            timeout=_GOODBYE_S,
            compress=False,
            max_msg_size=_MESSAGE_BYTES,
            heartbeat=_HEARTBEAT_S,
            autoping=False,
        )
        await socket.prepare(request)
        messages = self._ear.messages(request, socket, TELEOP, key)
        holding = self._door.holding(visitor, socket)
        await self.audience.attend(page, visitor, socket, messages, holding)
        await self._ear.say_goodbye(request, socket)
        return socket

    def _page_of(self, request: web.Request, page: str) -> str:
        """Return the page that a socket is for, unless it is none, or that of another login."""
        if not PAGE.fullmatch(page):
            raise web.HTTPBadRequest(text="A page id is 16 hex digits.")
        owner = self.audience.owner(page)
        if owner is not None and owner.key != visitor_of(request).key:
            raise web.HTTPForbidden(text="This page belongs to another login.")
        return page


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    if "Content-Security-Policy" not in response.headers:  # The login page has rules of its own.
        response.headers.update(HEADERS)
    if request.path.startswith("/static/"):
        response.headers["Cache-Control"] = "no-cache"
