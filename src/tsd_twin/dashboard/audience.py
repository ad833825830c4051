"""All pages that are open: what there is to show goes to them, and what they send is obeyed."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import Literal

from aiohttp import WSMessage, WSMsgType, web

from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.floor import NoPicture, Picture
from tsd_twin.dashboard.protocol import Panel, Point, encode
from tsd_twin.dashboard.roster import Fleet, Roster
from tsd_twin.dashboard.session import Session
from tsd_twin.dashboard.visitor import Visitor
from tsd_twin.messages.service import Event


def _nothing(*_args: str) -> None:
    pass


class Audience:
    """A session for each page, on one event loop.

    `on_status` and `on_event` belong to that loop; `panel`, `point` and `choose` may be called from
    any thread.
    """

    def __init__(
        self,
        fleet: Fleet,
        on_released: Callable[[str], None] = _nothing,
        on_chosen: Callable[[str, str], None] = _nothing,
        picture: Picture | None = None,
    ) -> None:
        """Hear of the fleet.

        Called on the event loop: `on_released`, with the page, when the sliders of its panel shall
        spring back, and `on_chosen`, with page and robot id, when its menu is used. `picture` is
        what pages point at and draw on.
        """
        self._calls = Calls()
        self.roster = Roster(fleet, self._calls)
        """The robots that there are to see."""
        self._on_released, self._on_chosen = on_released, on_chosen
        self._picture: Picture = NoPicture() if picture is None else picture
        self._sessions: dict[str, Session] = {}
        self._sockets: dict[str, web.WebSocketResponse] = {}
        self._rejected = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        fleet.on_change(lambda: self._call_soon(self._tell_fleet))

    def open(self) -> None:
        """Begin: other threads are heard from now on, on the loop that runs this."""
        self._loop = asyncio.get_running_loop()

    def close(self) -> None:
        """End, once no page is there any more."""
        self._loop = None
        self._calls.close()

    async def dismiss(self) -> None:
        """Tell all pages that this is the end."""
        goodbyes = (
            socket.close(code=1001, message=b"the dashboard ends")
            for socket in self._sockets.values()
        )
        await asyncio.gather(*goodbyes)

    @property
    def rejected(self) -> int:
        """Number of messages from pages that were none."""
        return self._rejected + sum(session.rejected for session in self._sessions.values())

    # What there is to show.

    def on_status(self, robot_id: str) -> None:
        """Send a robot's new state to all pages that watch it."""
        # Also when nobody watches: it is noted since when the robot has been in its mode.
        if (state := self.roster.state(robot_id)) is not None:
            for session in self._watching(robot_id):
                session.show(state)

    def on_event(self, robot_id: str, event: Event) -> None:
        """Send an event to all pages that watch the robot, and keep it for those to come."""
        self.roster.note(robot_id, event)
        for session in self._watching(robot_id):
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
        self._to(page, lambda session: session.mail.panel(encode(message)))

    def point(self, page: str, robot_id: str, at: tuple[float, float, float]) -> None:
        """Tell a page which point of a ball was clicked on; from any thread.

        The page is what brings it up, under the same dead man's switch as its stick.
        """
        message = Point(robot=robot_id, at=at)
        self._to(page, lambda session: session.mail.post(encode(message)))

    def choose(self, page: str, robot_id: str) -> None:
        """Turn a page to another robot, as its panel asks; from any thread."""
        self._to(page, lambda session: session.choose(robot_id))

    def _watching(self, robot_id: str) -> list[Session]:
        return [each for each in self._sessions.values() if each.robot_id == robot_id]

    def _to(self, page: str, act: Callable[[Session], None]) -> None:
        def call() -> None:
            if (session := self._sessions.get(page)) is not None:
                act(session)

        self._call_soon(call)

    def _tell_fleet(self) -> None:
        for session in self._sessions.values():
            session.fleet_changed()

    def _call_soon(self, call: Callable[[], None]) -> None:
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # The loop has just been closed.
                self._loop.call_soon_threadsafe(call)

    # Who comes and goes.

    def robot_of(self, page: str) -> str | None:
        """Return the id of the robot that a page shows; from any thread."""
        session = self._sessions.get(page)
        return None if session is None else session.robot_id

    def owner(self, page: str) -> Visitor | None:
        """Return whose page that is; None: nobody has it open."""
        session = self._sessions.get(page)
        return None if session is None else session.visitor

    async def attend(
        self,
        page: str,
        visitor: Visitor,
        socket: web.WebSocketResponse,
        messages: AsyncIterator[WSMessage],
        holding: contextlib.AbstractContextManager[None],
    ) -> None:
        """Have a page for as long as its socket is open; `holding` is what its visitor keeps.

        `messages` are what the socket says.
        """
        if (before := self._sockets.get(page)) is not None:  # Its connection was lost unnoticed.
            await before.close(code=1001, message=b"the page has come back")
        session = Session(
            page,
            self.roster,
            self._calls,
            self._on_released,
            self._on_chosen,
            visitor=visitor,
            picture=self._picture,
        )
        self._sessions[page], self._sockets[page] = session, socket
        delivering = asyncio.create_task(session.mail.deliver(socket))
        try:
            with holding:
                session.fleet_changed()
                async for message in messages:
                    if message.type is WSMsgType.TEXT:
                        session.receive(message.data)
                    else:
                        session.reject("shape: messages are text")
        finally:
            delivering.cancel()
            await asyncio.gather(delivering, return_exceptions=True)
            await self._end(session, socket)

    async def _end(self, session: Session, socket: web.WebSocketResponse) -> None:
        await session.close()
        self._rejected += session.rejected
        if self._sockets.get(session.page) is socket:
            del self._sessions[session.page], self._sockets[session.page]
