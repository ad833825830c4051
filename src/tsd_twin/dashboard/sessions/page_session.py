"""Base of the sessions of pages, live or with a recording: identity, messages, view and stops."""

from __future__ import annotations

import asyncio
import dataclasses
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, TypeAlias

import msgspec
from aiohttp import WSMessage, WSMsgType, web

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.scene.client_views import PageView, SceneExecutor
from tsd_twin.dashboard.scene.framing import Rectangle
from tsd_twin.dashboard.sessions.permitted_robots import PermittedRobots
from tsd_twin.dashboard.sessions.principal import Principal, operator_name, shown_name
from tsd_twin.dashboard.sessions.send_queue import Lane, SendQueue
from tsd_twin.dashboard.sessions.stops import LiveRobots, PageStops
from tsd_twin.dashboard.wire.from_page import (
    PageHeartbeat,
    SelectPlotFields,
    SetFrame,
    SetView,
    ShowFleet,
    StopCommand,
)
from tsd_twin.dashboard.wire.to_page import (
    ActionReply,
    HeartbeatReply,
    RobotName,
    SessionInfo,
    encode_message,
)
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.security import Role
from tsd_twin.security.router_rules import EVERY_ROBOT

VIEWER_REFUSAL = because(Code.VIEWER)
CommonMessage: TypeAlias = PageHeartbeat | SelectPlotFields | SetFrame | SetView | ShowFleet
"""Messages that all sessions handle alike."""
WATCH_REFUSAL = because(Code.WATCH_ONLY)


@dataclass(frozen=True, slots=True)
class PageSocket:
    """Open socket of a page."""

    page: str
    principal: Principal
    """Owner of the page."""
    socket: web.WebSocketResponse
    messages: AsyncIterator[WSMessage]
    holding: AbstractContextManager[None]
    """Context of the session."""
    name: str = ""
    """Name typed by the operator, used only without logins."""


class PageSession(ABC):
    """Session of a page while its socket is open; event loop only."""

    def __init__(self, socket: PageSocket, live: LiveRobots, scene: SceneExecutor) -> None:
        """`live` are the robots that the page can stop; each page has its own operator id."""
        self._socket = socket
        self.page, self.principal = socket.page, socket.principal
        self.robot_id: str | None = None
        """Selected robot."""
        self.view = PageView()
        """View that the page has asked for, without its robot."""
        self.rejected = 0
        """Number of invalid messages."""
        self._operator = f"{operator_name(self.principal, socket.name)}-{self.page[:8]}"
        if self.principal.rights != EVERY_ROBOT:
            permitted = PermittedRobots(live.directory, self.principal.rights)
            live = dataclasses.replace(live, directory=permitted)
        self._live, self._scene = live, scene
        self._queue = SendQueue()
        self._stops = PageStops(live, self._operator, self.send)
        self._stops.name = shown_name(self.principal, socket.name)
        self._plot_fields: Sequence[str] = ()
        self._shows_map = False

    async def run(self) -> None:
        """Exchange messages until the socket is closed."""
        delivering = asyncio.create_task(self._queue.run(self._socket.socket))
        try:
            with self._socket.holding:
                await self.open()
                async for message in self._socket.messages:
                    if message.type is WSMsgType.TEXT:
                        self.receive(message.data)
                    else:
                        self.reject(MessageError("shape", "messages are text"))
        finally:
            delivering.cancel()
            await asyncio.gather(delivering, return_exceptions=True)
            self._live.feed.unsubscribe(self._queue)
            await self.close()

    async def close_socket(self, why: str) -> None:
        """Close the socket, which ends the session."""
        await self._socket.socket.close(code=1001, message=why.encode())

    @abstractmethod
    async def open(self) -> None:
        """Send the first messages."""

    @abstractmethod
    def receive(self, text: str | bytes) -> None:
        """Handle one message; invalid messages raise nothing."""

    @abstractmethod
    async def close(self) -> None:
        """End the session, after the socket has closed."""

    def reject(self, error: MessageError) -> None:
        """Count an invalid message and reply to it."""
        self.rejected += 1
        if self.rejected == 1:
            self.send(ActionReply(to="message", ok=False, why=error.why))

    def send(self, message: Any) -> None:
        """Queue a message to the page."""
        self._queue.put(encode_message(message))

    def _handle_common(self, message: CommonMessage) -> None:
        match message:
            case PageHeartbeat():
                self._queue.acknowledge(message.status_seq)
            case SelectPlotFields():
                self._plot_fields = message.names
            case SetView(settings=settings, look=look):
                self.view = self.view._replace(settings=settings)
                self._scene.draw(self.page, "view", lambda view: view.apply(settings, look=look))
            case SetFrame():
                frame = Rectangle(*msgspec.structs.astuple(message))
                self.view = self.view._replace(frame=frame)
                self._scene.draw(self.page, "frame", lambda view: view.set_frame(frame))
            case ShowFleet(on=True):
                self._live.feed.subscribe(self._queue, self.principal.rights)
            case ShowFleet():
                self._live.feed.unsubscribe(self._queue)

    def _show_robot(self, robot_id: str) -> None:
        """Show a robot in the scene of the page."""
        self.robot_id = robot_id
        self._scene.draw(self.page, "robot", lambda view: view.select_robot(robot_id))

    def _echo(self, message: PageHeartbeat, lane: Lane | None = None) -> None:
        """Answer a heartbeat on the socket that it measures."""
        (lane or self._queue).put(encode_message(HeartbeatReply(sent_ms=message.sent_ms)))

    def _stop(self, message: StopCommand, shown: str | None) -> Sequence[RobotMonitor]:
        """Publish a stop and return its target robots; `shown` is the robot that the page shows."""
        if self.principal.may_stop:
            return self._stops.stop(message, shown)
        self.send(ActionReply(to="stop", ok=False, why=VIEWER_REFUSAL))
        return ()

    def _send_welcome(self, role: Role, robots: Sequence[RobotName]) -> None:
        self.send(
            SessionInfo(
                operator=self._operator,
                name=self._stops.name,
                role=role,
                user=self.principal.user,
                may_stop=self.principal.may_stop,
                robots=robots,
                robot=self.robot_id,
            )
        )
