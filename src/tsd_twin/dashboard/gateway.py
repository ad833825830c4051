"""What the operator's browser speaks to: viser's page with our controls, and their socket."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Literal

import msgspec
from aiohttp import WSMsgType, web

from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.door import Door, Rules, visitor_of
from tsd_twin.dashboard.floor import NoPicture, Picture
from tsd_twin.dashboard.guard import HEADERS
from tsd_twin.dashboard.pages import STATIC, IndexPage
from tsd_twin.dashboard.protocol import Panel, Point, encode
from tsd_twin.dashboard.proxy import PAGE, ViserProxy
from tsd_twin.dashboard.reception import Reception
from tsd_twin.dashboard.roster import Fleet, Roster
from tsd_twin.dashboard.session import Session
from tsd_twin.errors import TwinError
from tsd_twin.messages.service import Event

_BODY_BYTES = 2048
_MESSAGE_BYTES = 16 * 2**10
"""The longest message of a page is a line that was drawn; all others have fewer than 200."""
_HEARTBEAT_S = 5.0
_GOODBYE_S = 0.5
_PATIENCE_S = 3.0


def _nothing(*_args: str) -> None:
    pass


class Gateway:
    """One HTTP server on one event loop.

    `on_status` and `on_event` belong to that loop; `panel` and `choose` may be called from any
    thread.
    """

    def __init__(
        self,
        fleet: Fleet,
        viser_port: int,
        *,
        door: Door | None = None,
        on_released: Callable[[str], None] = _nothing,
        on_chosen: Callable[[str, str], None] = _nothing,
        picture: Picture | None = None,
    ) -> None:
        """Read viser's page.

        `door` decides who may come in; without one everybody may, from this machine. Called on the
        event loop: `on_released`, with the page, when the sliders of its panel shall spring back,
        and `on_chosen`, with page and robot id, when its menu is used. `picture` is what pages
        point at and draw on.

        Raises:
            TwinError: viser's page cannot be used.
        """
        self._index = IndexPage()
        self._door = Door(Rules()) if door is None else door
        self._reception = Reception(self._door)
        self._proxy = ViserProxy(viser_port)
        self._calls = Calls()
        self._roster = Roster(fleet, self._calls)
        self._on_released, self._on_chosen = on_released, on_chosen
        self._picture: Picture = NoPicture() if picture is None else picture
        self._sessions: dict[str, Session] = {}
        self._sockets: dict[str, web.WebSocketResponse] = {}
        self._rejected = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._runner: web.AppRunner | None = None
        self._watching: list[asyncio.Task[None]] = []
        self.port = 0
        """Where the gateway listens, once it has been started."""
        fleet.on_change(self._fleet_changed)

    async def start(self, host: str = "127.0.0.1", port: int = 8080) -> None:
        """Listen; port 0 takes a free one.

        Raises:
            TwinError: the port is in use, or others could come in, or read what is said.
        """
        self._door.rules.check(host)
        self._loop = asyncio.get_running_loop()
        app = web.Application(middlewares=[self._door.guard], client_max_size=_BODY_BYTES)
        app.on_response_prepare.append(_add_headers)
        app.router.add_get("/", self._index.serve)
        app.router.add_get("/healthz", self._serve_health)
        app.router.add_get("/teleop", self._serve_teleop)
        app.router.add_get("/viser/{page}", self._serve_viser)
        self._reception.add_to(app.router)
        app.router.add_static("/static", STATIC)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=_PATIENCE_S)
        await runner.setup()
        site = web.TCPSite(runner, host, port, ssl_context=self._door.rules.tls)
        try:
            await site.start()
        except OSError as error:
            await runner.cleanup()
            raise TwinError(f"port {port} of {host} cannot be used: choose another") from error
        self.port = runner.addresses[0][1]
        self._door.open(host, self.port)
        self._runner = runner
        watching = (self._roster.measure(), self._door.watch())
        self._watching = [asyncio.create_task(work) for work in watching]

    async def stop(self) -> None:
        """Let go of all robots, close all sockets, and listen no more."""
        if self._runner is None:
            return
        for task in self._watching:
            task.cancel()
        goodbyes = (
            socket.close(code=1001, message=b"the dashboard ends")
            for socket in self._sockets.values()
        )
        await asyncio.gather(*goodbyes)
        await self._proxy.close()
        await self._runner.cleanup()
        self._runner, self._loop = None, None
        self._calls.close()
        self._reception.close()

    @property
    def rejected(self) -> int:
        """Number of messages from pages that were none."""
        return self._rejected + sum(session.rejected for session in self._sessions.values())

    # What there is to show.

    def on_status(self, robot_id: str) -> None:
        """Send a robot's new state to all pages that watch it."""
        # Also when nobody watches: it is noted since when the robot has been in its mode.
        if (state := self._roster.state(robot_id)) is not None:
            for session in self._sessions.values():
                if session.robot_id == robot_id:
                    session.show(state)

    def on_event(self, robot_id: str, event: Event) -> None:
        """Send an event to all pages that watch the robot, and keep it for those to come."""
        self._roster.note(robot_id, event)
        for session in self._sessions.values():
            if session.robot_id == robot_id:
                session.tell(event)

    def panel(
        self,
        page: str,
        vx: float,
        vy: float,
        omega: float,
        mode: Literal["preview", "drive"],
        latch: bool,
    ) -> None:
        """Tell a page where the sliders of its panel are, m/s and rad/s; from any thread.

        The page is what streams them, so they obey the same dead man's switch as its stick.
        """
        message = Panel(vx=vx, vy=vy, omega=omega, mode=mode, latch=latch)
        self._call_soon(lambda: self._tell_panel(page, message))

    def point(self, page: str, robot_id: str, at: tuple[float, float, float]) -> None:
        """Tell a page which point of a ball was clicked on; from any thread.

        The page is what brings it up, under the same dead man's switch as its stick.
        """
        message = Point(robot=robot_id, at=at)
        self._call_soon(lambda: self._tell_page(page, message))

    def choose(self, page: str, robot_id: str) -> None:
        """Turn a page to another robot, as its panel asks; from any thread."""
        self._call_soon(lambda: self._turn(page, robot_id))

    def _turn(self, page: str, robot_id: str) -> None:
        if (session := self._sessions.get(page)) is not None:
            session.choose(robot_id)

    def _tell_panel(self, page: str, message: Panel) -> None:
        if (session := self._sessions.get(page)) is not None:
            session.mail.panel(encode(message))

    def _tell_page(self, page: str, message: Point) -> None:
        if (session := self._sessions.get(page)) is not None:
            session.mail.post(encode(message))

    def _fleet_changed(self) -> None:
        self._call_soon(self._tell_fleet)

    def _tell_fleet(self) -> None:
        for session in self._sessions.values():
            session.fleet_changed()

    def _call_soon(self, call: Callable[[], None]) -> None:
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # The loop has just been closed.
                self._loop.call_soon_threadsafe(call)

    # What is served.

    async def _serve_health(self, request: web.Request) -> web.StreamResponse:
        del request
        robots = self._roster.health()
        ready = self._roster.sees_a_robot()
        body = msgspec.json.encode({"ready": ready, "robots": robots})
        return web.Response(
            body=body, content_type="application/json", headers={"Cache-Control": "no-store"}
        )

    async def _serve_viser(self, request: web.Request) -> web.StreamResponse:
        page, visitor = self._page_of(request, request.match_info["page"]), visitor_of(request)
        return await self._proxy.serve(
            request, page, visitor, lambda socket: self._door.holding(visitor, socket)
        )

    async def _serve_teleop(self, request: web.Request) -> web.StreamResponse:
        page, visitor = self._page_of(request, request.query.get("page", "")), visitor_of(request)
        socket = web.WebSocketResponse(
            timeout=_GOODBYE_S, compress=False, max_msg_size=_MESSAGE_BYTES, heartbeat=_HEARTBEAT_S
        )
        await socket.prepare(request)
        if (before := self._sockets.get(page)) is not None:  # Its connection was lost unnoticed.
            await before.close(code=1001, message=b"the page has come back")
        session = Session(
            page,
            self._roster,
            self._calls,
            self._on_released,
            self._on_chosen,
            visitor=visitor,
            picture=self._picture,
        )
        self._sessions[page], self._sockets[page] = session, socket
        delivering = asyncio.create_task(session.mail.deliver(socket))
        try:
            with self._door.holding(visitor, socket):
                session.fleet_changed()
                async for message in socket:
                    if message.type is WSMsgType.TEXT:
                        session.receive(message.data)
                    else:
                        session.reject("shape: messages are text")
        finally:
            delivering.cancel()
            await asyncio.gather(delivering, return_exceptions=True)
            await self._end(session, socket)
        return socket

    def _page_of(self, request: web.Request, page: str) -> str:
        """Return the page that a socket is for, unless it is none, or that of another login."""
        if not PAGE.fullmatch(page):
            raise web.HTTPBadRequest(text="A page id is 16 hex digits.")
        session = self._sessions.get(page)
        if session is not None and session.visitor.key != visitor_of(request).key:
            raise web.HTTPForbidden(text="This page belongs to another login.")
        return page

    async def _end(self, session: Session, socket: web.WebSocketResponse) -> None:
        await session.close()
        self._rejected += session.rejected
        if self._sockets.get(session.page) is socket:
            del self._sessions[session.page], self._sockets[session.page]


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    if "Content-Security-Policy" not in response.headers:  # The login page has rules of its own.
        response.headers.update(HEADERS)
    if request.path.startswith("/static/"):
        response.headers["Cache-Control"] = "no-cache"
