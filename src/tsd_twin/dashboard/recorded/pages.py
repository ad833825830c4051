"""Pages that show recordings, each with its own view and session."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from tsd_twin.dashboard.recorded.library import RecordingLibrary
from tsd_twin.dashboard.recorded.session import RecordedSession
from tsd_twin.dashboard.recorded.view import RecordedView
from tsd_twin.dashboard.sessions.page_session import PageSocket
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.dashboard.sessions.stops import LiveRobots
from tsd_twin.dashboard.wire.from_page import Message
from tsd_twin.errors import TwinError
from tsd_twin.recording.remote import ReaderProcesses, RemoteReader
from tsd_twin.recording.titles import FolderError

MAX_VIEWS = 5
"""Maximum number of pages that show recordings; each keeps a scene in memory."""
IDLE_TIMEOUT_S = 3.0
"""Time a view stays open without sockets, because a page reconnects its two sockets separately."""


@dataclass(slots=True)
class _OpenView:
    owner: Principal
    opening: asyncio.Task[RecordedView]
    uses: int = 0
    """Number of sockets."""


class RecordedPages:
    """All pages that show recordings in a folder; event loop only."""

    def __init__(self, folder: Path, live: LiveRobots) -> None:
        self._live = live
        self._processes = ReaderProcesses()
        self.library = RecordingLibrary(folder, self._processes)
        """Files of the folder."""
        self._sessions: set[RecordedSession] = set()
        self._views: dict[str, _OpenView] = {}
        self._ended = asyncio.Event()
        self._closing: set[asyncio.Task[None]] = set()

    async def close(self) -> None:
        """Close all sockets and views."""
        await asyncio.gather(*(each.close_socket("the dashboard ends") for each in self._sessions))
        self._ended.set()
        await asyncio.gather(*(self._close(page) for page in list(self._views)))
        await asyncio.gather(*self._closing, return_exceptions=True)
        await self.library.close()
        await asyncio.to_thread(self._processes.close)

    def send_to_all(self, message: Message) -> None:
        """Send a message to all pages that show recordings."""
        for session in self._sessions:
            session.send(message)

    def _open(self, path: Path) -> RecordedView:
        return RecordedView(path, RemoteReader(path, self._processes))

    @contextlib.asynccontextmanager
    async def view(
        self, page: str, name: str, principal: Principal
    ) -> AsyncGenerator[RecordedView]:
        """Context with the view of a page, opened for its first socket.

        Raises:
            HTTPException: If the recording is missing or cannot be shown, or too many are open.
        """
        path: Path | None = None
        if page not in self._views:
            try:
                path = await self.library.permitted_file(name, principal.rights)
            except FolderError as error:
                raise web.HTTPNotFound(text="There is no such recording.") from error
        # The other socket of the page may have opened it during the wait.
        opened = self._views.get(page)
        if opened is not None and opened.owner.key != principal.key:
            raise web.HTTPForbidden(text="This page belongs to another login.")
        if opened is None:
            if path is None:
                raise web.HTTPNotFound(text="There is no such recording.")
            if len(self._views) >= MAX_VIEWS:  # Close idle views first.
                idle = [each for each, view in self._views.items() if not view.uses]
                await asyncio.gather(*(self._close(each) for each in idle))
            if len(self._views) >= MAX_VIEWS:
                raise web.HTTPServiceUnavailable(text="Too many pages show recordings.")
            opening = asyncio.create_task(asyncio.to_thread(self._open, path))
            opened = self._views[page] = _OpenView(principal, opening)
        opened.uses += 1
        try:
            try:
                view = await asyncio.shield(opened.opening)
            except TwinError as error:
                raise web.HTTPNotFound(text=f"{error}.") from error
            yield view
        finally:
            opened.uses -= 1
            task = asyncio.create_task(self._close_unused(page))
            self._closing.add(task)
            task.add_done_callback(self._closing.discard)

    async def run_session(self, view: RecordedView, socket: PageSocket) -> None:
        """Run the session of a page while its socket is open."""
        session = RecordedSession(socket, view, self._live, on_marked=self.library.changed)
        self._sessions.add(session)
        try:
            await session.run()
        finally:
            self._sessions.discard(session)

    async def _close_unused(self, page: str) -> None:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._ended.wait(), IDLE_TIMEOUT_S)
        opened = self._views.get(page)
        if opened is not None and not opened.uses:
            await self._close(page)

    async def _close(self, page: str) -> None:
        opened = self._views.pop(page, None)
        if opened is not None:
            with contextlib.suppress(Exception):  # Opening may have failed.
                view = await opened.opening
                await asyncio.to_thread(view.close)
