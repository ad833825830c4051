"""Pages that show recordings, each with its own view and session, and the list of recordings."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import msgspec
from aiohttp import WSMessage, WSMsgType, web

from tsd_twin.dashboard.recorded.session import RecordedSession
from tsd_twin.dashboard.recorded.view import RecordedView
from tsd_twin.dashboard.scene.appearance import RobotRoster
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.dashboard.wire.to_page import RecordedPath
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.errors import TwinError
from tsd_twin.messages.services import Reply
from tsd_twin.recording.folder import Catalogue
from tsd_twin.recording.remote import ReaderProcesses, RemoteFolderReader, RemoteReader

MAX_VIEWS = 5
"""Maximum number of pages that show recordings; each keeps a scene in memory."""
IDLE_TIMEOUT_S = 3.0
"""Time a view stays open without sockets, because a page reconnects its two sockets separately."""
_PATH_POINTS = 64
_PATHS_KEPT = 256
_PATH_BYTES = 1 << 20
"""Growth after which the path preview of an unfinished recording is computed again."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,120}\.mcap")


class RecordedPages:
    """All pages that show recordings in a folder; event loop only."""

    def __init__(self, folder: Path, stop_all: Callable[[str], Awaitable[Reply]]) -> None:
        self._folder = folder
        self._stop_all = stop_all
        self._processes = ReaderProcesses()
        self._reader = RemoteFolderReader(self._processes)
        self._catalogue = Catalogue(folder, self._reader)
        self._listing = asyncio.Lock()
        self._paths: dict[tuple[str, int], bytes] = {}
        self._views: dict[str, asyncio.Task[RecordedView]] = {}
        self._uses: dict[str, int] = {}
        self._owners: dict[str, Principal] = {}
        self._sessions: dict[str, RecordedSession] = {}
        self._ended = asyncio.Event()
        self._sockets: set[web.WebSocketResponse] = set()
        self._closing: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def close(self) -> None:
        """Close all sockets and views."""
        await asyncio.gather(
            *(each.close(code=1001, message=b"the dashboard ends") for each in self._sockets)
        )
        self._ended.set()
        await asyncio.gather(*(self._close(page) for page in list(self._views)))
        await asyncio.gather(*self._closing, return_exceptions=True)
        self._catalogue.close()
        await asyncio.to_thread(self._processes.close)

    async def serve_list(self, _request: web.Request) -> web.StreamResponse:
        """Answer `GET recordings` with a list as JSON."""
        async with self._listing:
            found = await asyncio.to_thread(self._catalogue.recordings)
        body: list[dict[str, Any]] = [
            {
                "name": path.name,
                "start_ms": each.start_ns // 1_000_000,
                "duration_s": round(each.duration_s, 1),
                "robots": each.robots,
                "marks": each.marks,
                "is_whole": each.is_whole,
            }
            for path, each in found.items()
            if each.robots
        ]
        return web.Response(
            body=msgspec.json.encode(body),
            content_type="application/json",
            headers={"Cache-Control": "no-store"},
        )

    async def serve_path(self, request: web.Request) -> web.StreamResponse:
        """Answer `GET recordings/<name>/path` with the paths of the robots as JSON."""
        path = self._file(request.match_info["name"])
        try:
            async with self._listing:
                key = path.name, path.stat().st_size // _PATH_BYTES
                if key not in self._paths:
                    self._paths[key] = await asyncio.to_thread(self._path, path)
                    for oldest in list(self._paths)[:-_PATHS_KEPT]:
                        del self._paths[oldest]
                body = self._paths[key]
        except (TwinError, OSError) as error:
            raise web.HTTPNotFound(text="It cannot be shown.") from error
        return web.Response(
            body=body, content_type="application/json", headers={"Cache-Control": "no-store"}
        )

    def _path(self, path: Path) -> bytes:
        """Return the paths of all robots of a recording as JSON.

        Raises:
            RecordingError: If the file is not a recording.
        """
        roster = RobotRoster()
        tracks = self._reader.track(path, _PATH_POINTS + 1)
        return msgspec.json.encode(
            [
                RecordedPath(each, "#{:02x}{:02x}{:02x}".format(*roster.colour(each)), points)
                for each, points in tracks.items()
            ]
        )

    def _open(self, path: Path) -> RecordedView:
        reader = RemoteReader(path, self._processes)
        return RecordedView(path, reader, self._on_robot, self._on_view)

    def _file(self, name: str) -> Path:
        if not _NAME.fullmatch(name) or not (self._folder / name).is_file():
            raise web.HTTPNotFound(text="There is no such recording.")
        return self._folder / name

    @contextlib.asynccontextmanager
    async def view(
        self, page: str, name: str, principal: Principal
    ) -> AsyncGenerator[RecordedView]:
        """Context with the view of a page, opened for its first socket.

        Raises:
            HTTPException: If the recording is missing or cannot be shown, or too many are open.
        """
        owner = self._owners.get(page)
        if owner is not None and owner.key != principal.key:
            raise web.HTTPForbidden(text="This page belongs to another login.")
        if page not in self._views:
            path = self._file(name)
            if len(self._views) >= MAX_VIEWS:  # Close idle views first.
                idle = [each for each in self._views if not self._uses.get(each)]
                await asyncio.gather(*(self._close(each) for each in idle))
            if len(self._views) >= MAX_VIEWS:
                raise web.HTTPServiceUnavailable(text="Too many pages show recordings.")
            self._loop = asyncio.get_running_loop()
            self._owners[page] = principal
            self._views[page] = asyncio.create_task(asyncio.to_thread(self._open, path))
        self._uses[page] = self._uses.get(page, 0) + 1
        try:
            try:
                view = await asyncio.shield(self._views[page])
            except TwinError as error:
                raise web.HTTPNotFound(text=f"{error}.") from error
            yield view
        finally:
            self._uses[page] -= 1
            task = asyncio.create_task(self._close_unused(page))
            self._closing.add(task)
            task.add_done_callback(self._closing.discard)

    async def run_session(
        self,
        page: str,
        view: RecordedView,
        principal: Principal,
        socket: web.WebSocketResponse,
        messages: AsyncIterator[WSMessage],
        holding: AbstractContextManager[None],
        *,
        name: str = "",
    ) -> None:
        """Run the session of a page while its socket is open, within `holding`."""
        session = RecordedSession(page, view, self._stop_all, principal=principal, name=name)
        self._sessions[page] = session
        self._sockets.add(socket)
        delivering = asyncio.create_task(session.send_queue.run(socket))
        try:
            with holding:
                await session.open()
                async for message in messages:
                    if message.type is WSMsgType.TEXT:
                        session.receive(message.data)
        finally:
            session.close()
            self._sockets.discard(socket)
            delivering.cancel()
            await asyncio.gather(delivering, return_exceptions=True)
            if self._sessions.get(page) is session:
                del self._sessions[page]

    # Called on viser's threads.

    def _on_robot(self, page: str, robot_id: str) -> None:
        self._with_session(page, lambda session: session.select_robot(robot_id))

    def _on_view(self, page: str, settings: ViewSettings) -> None:
        self._with_session(page, lambda session: session.on_view(settings))

    def _with_session(self, page: str, act: Callable[[RecordedSession], None]) -> None:
        def call() -> None:
            if (session := self._sessions.get(page)) is not None:
                act(session)

        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # The loop may have closed.
                self._loop.call_soon_threadsafe(call)

    async def _close_unused(self, page: str) -> None:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._ended.wait(), IDLE_TIMEOUT_S)
        if not self._uses.get(page):
            await self._close(page)

    async def _close(self, page: str) -> None:
        task = self._views.pop(page, None)
        self._uses.pop(page, None)
        self._owners.pop(page, None)
        if task is not None:
            with contextlib.suppress(Exception):  # Opening may have failed.
                view = await task
                await asyncio.to_thread(view.close)
