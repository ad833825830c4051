"""Session manager: one session per connected page, on one event loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.scene.appearance import RobotRoster
from tsd_twin.dashboard.scene.client_views import PageView, SceneExecutor
from tsd_twin.dashboard.sessions.fleet_feed import FleetFeed
from tsd_twin.dashboard.sessions.lease import RpcExecutor
from tsd_twin.dashboard.sessions.map_data import MapData
from tsd_twin.dashboard.sessions.page_session import PageSocket
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.dashboard.sessions.robot_directory import RobotDirectory
from tsd_twin.dashboard.sessions.session import Session
from tsd_twin.dashboard.sessions.stops import LiveRobots
from tsd_twin.dashboard.wire.from_page import Message
from tsd_twin.dashboard.wire.to_page import SphereClick
from tsd_twin.messages.events import Event

MAX_LANES = 3
"""Most lanes of a page: sockets in addition to its main one."""


class SessionManager:
    """Sessions of all connected pages, on one event loop.

    `on_status` and `on_event` belong to that loop; `on_sphere_click` and
    `on_robots_changed` may be called from any thread.
    """

    def __init__(
        self,
        links: Mapping[str, RobotMonitor],
        scene: SceneExecutor,
        *,
        on_opened: Callable[[], None] = lambda: None,
        roster: RobotRoster | None = None,
    ) -> None:
        """Initialise the manager without sessions; `links` is a live view of all robots.

        `on_opened` reports a new page on the event loop; `roster` defines the order and colours of
        robots.
        """
        self._executor = RpcExecutor()
        self.directory = RobotDirectory(links, self._executor, roster)
        """All robots visible to pages."""
        self.live = LiveRobots(
            self.directory,
            self._executor,
            FleetFeed(self.directory, self.is_shown),
        )
        """Robots that pages list and stop, including pages with a recording."""
        self._on_opened = on_opened
        self._scene = scene
        self._map_data = MapData(links, scene, self._on_map_lines)
        self._sessions: dict[str, Session] = {}
        self._rejected = 0
        self._loop: asyncio.AbstractEventLoop | None = None

    def open(self) -> None:
        """Start on the running event loop and accept calls from other threads."""
        self._loop = asyncio.get_running_loop()

    def close(self) -> None:
        """Stop, after the last session has ended."""
        self._loop = None
        self.directory.close()
        self._executor.close()

    async def close_sockets(self) -> None:
        """Close the sockets of all pages."""
        sessions = self._sessions.values()
        await asyncio.gather(*(each.close_socket("the dashboard ends") for each in sessions))

    @property
    def any_open(self) -> bool:
        """Whether a page shows live robots; thread-safe."""
        return bool(self._sessions) or self.live.feed.has_subscribers

    @property
    def rejected(self) -> int:
        """Number of invalid messages from pages."""
        return self._rejected + sum(session.rejected for session in self._sessions.values())

    # State and events to the pages.

    def on_status(self, robot_id: str) -> None:
        """Handle a robot's new status in all sessions that have it selected, then show it."""
        self._map_data.on_status(robot_id)
        self.directory.note_status(robot_id)
        if not (sessions := self._sessions_showing(robot_id)):
            return
        if (state := self.directory.state(robot_id)) is None:
            return
        for session in sessions:
            session.decide(state.status)
        for session in sessions:
            session.show(state)

    def on_event(self, robot_id: str, event: Event) -> None:
        """Store an event, and send it to all pages that have the robot selected."""
        self.directory.add_event(robot_id, event)
        for session in self._sessions_showing(robot_id):
            session.send_event(event)

    def send_to_all(self, message: Message) -> None:
        """Send a message to all pages."""
        for session in self._sessions.values():
            session.send(message)

    def on_sphere_click(self, page: str, robot_id: str, at: tuple[float, float, float]) -> None:
        """Send a page the clicked point of a sphere; thread-safe.

        The page commands the motion, subject to the same dead-man switch as its stick.
        """

        def call() -> None:
            if (session := self._sessions.get(page)) is not None:
                session.send(SphereClick(robot=robot_id, at=at))

        self._call_soon(call)

    def on_robots_changed(self) -> None:
        """Send all pages the list of robots; thread-safe."""

        def call() -> None:
            for session in self._sessions.values():
                session.on_robots_changed()

        self._call_soon(call)

    def is_shown(self, robot_id: str) -> bool:
        """Return whether a page has a robot selected; thread-safe."""
        return any(each.robot_id == robot_id for each in list(self._sessions.values()))

    def _sessions_showing(self, robot_id: str) -> list[Session]:
        return [each for each in self._sessions.values() if each.robot_id == robot_id]

    def _on_map_lines(self, *, trails: bool = False) -> None:
        for session in self._sessions.values():
            session.send_map_lines(trails=trails)

    def _call_soon(self, call: Callable[[], None]) -> None:
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # The loop may have closed.
                self._loop.call_soon_threadsafe(call)

    # Pages that connect and disconnect.

    def view_of(self, page: str) -> PageView:
        """Return the view that a page has asked for; thread-safe."""
        session = self._sessions.get(page)
        return PageView() if session is None else session.view._replace(robot_id=session.robot_id)

    def principal_of(self, page: str) -> Principal | None:
        """Return the principal of a page, or None if the page is not open."""
        session = self._sessions.get(page)
        return None if session is None else session.principal

    def accepts_lane(self, page: str) -> bool:
        """Return whether a page is open and has fewer than `MAX_LANES`."""
        session = self._sessions.get(page)
        return session is not None and session.lane_count < MAX_LANES

    async def run_lane(self, socket: PageSocket) -> None:
        """Run a lane of a page, if the page is still open, until either is closed."""
        if (session := self._sessions.get(socket.page)) is not None:
            await session.run_lane(socket)

    async def run_session(self, socket: PageSocket) -> None:
        """Run the session of a page while its socket is open."""
        page = socket.page
        if (before := self._sessions.get(page)) is not None:  # Its connection was lost silently.
            await before.close_socket("the page has come back")
        session = Session(socket, self.live, self._scene, self._map_data)
        self._sessions[page] = session
        self._on_opened()
        try:
            await session.run()
        finally:
            self._rejected += session.rejected
            if self._sessions.get(page) is session:
                del self._sessions[page]
