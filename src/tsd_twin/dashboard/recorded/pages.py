"""Pages that show recordings, each with its own view and session, and the list of recordings."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from aiohttp import WSMessage, WSMsgType, web

from tsd_twin.dashboard.recorded.session import RecordedSession
from tsd_twin.dashboard.recorded.view import RecordedView
from tsd_twin.dashboard.scene.appearance import RobotRoster
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.dashboard.sessions.stops import LiveRobots
from tsd_twin.dashboard.wire.to_page import RecordedPath
from tsd_twin.errors import TwinError
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


@dataclass(slots=True)
class _OpenView:
    owner: Principal
    opening: asyncio.Task[RecordedView]
    uses: int = 0
    """Number of sockets."""


class RecordedPages:
    """All pages that show recordings in a folder; event loop only."""

    def __init__(self, folder: Path, live: LiveRobots) -> None:
        self._folder = folder
        self._live = live
        self._processes = ReaderProcesses()
        self._reader = RemoteFolderReader(self._processes)
        self._catalogue = Catalogue(folder, self._reader)
        self._listing = asyncio.Lock()
        self._paths: dict[tuple[str, int], bytes] = {}
        self._views: dict[str, _OpenView] = {}
        self._ended = asyncio.Event()
        self._sockets: set[web.WebSocketResponse] = set()
        self._closing: set[asyncio.Task[None]] = set()

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
        listed: list[dict[str, Any]] = [
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
        return json_response(msgspec.json.encode(listed))

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
        return json_response(body)

    def _path(self, path: Path) -> bytes:
        """Return the paths of all robots of a recording as JSON.

        Raises:
            RecordingError: If the file is not a recording.
        """
        roster = RobotRoster()
        tracks = self._reader.track(path, _PATH_POINTS + 1)
        return msgspec.json.encode(
            [RecordedPath(each, roster.css_colour(each), points) for each, points in tracks.items()]
        )

    def _open(self, path: Path) -> RecordedView:
        return RecordedView(path, RemoteReader(path, self._processes))

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
        opened = self._views.get(page)
        if opened is not None and opened.owner.key != principal.key:
            raise web.HTTPForbidden(text="This page belongs to another login.")
        if opened is None:
            path = self._file(name)
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

    async def run_session(
        self,
        view: RecordedView,
        page: str,
        principal: Principal,
        socket: web.WebSocketResponse,
        messages: AsyncIterator[WSMessage],
        holding: AbstractContextManager[None],
        *,
        name: str = "",
    ) -> None:
        """Run the session of a page while its socket is open, within `holding`."""
        session = RecordedSession(page, view, self._live, principal=principal, name=name)
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


def json_response(body: bytes) -> web.Response:
    """Return a response that no browser stores."""
    return web.Response(
        body=body, content_type="application/json", headers={"Cache-Control": "no-store"}
    )
