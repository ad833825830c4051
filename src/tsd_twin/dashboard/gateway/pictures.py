"""Routes of the cameras: their list, and WebSockets that send one picture per request."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import msgspec
from aiohttp import WSMsgType, web

from tsd_twin.dashboard.gateway.auth import PRINCIPAL
from tsd_twin.dashboard.gateway.recordings import json_response
from tsd_twin.dashboard.gateway.socket_limits import Quota, SocketLimits, SocketReader
from tsd_twin.dashboard.pictures.feed import Cameras, Viewer
from tsd_twin.dashboard.pictures.h264 import H264Stream
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.dashboard.wire.pictures import CameraEntry, PictureRequest
from tsd_twin.messages.pictures import CameraName
from tsd_twin.security.router_rules import ALL, RobotRights

MAX_SOCKETS = 8
"""Most sockets of a page: a lost segment stalls one of them only."""
LIMITS = SocketLimits(
    messages=Quota(120.0, 240.0), size=Quota(16e3, 48e3), kinds={}, other=Quota(120.0, 240.0)
)
"""One request per picture; cameras have at most 60 pictures per second."""
_WIDEST = 4096
_HEARTBEAT_S = 10.0


@dataclass(slots=True)
class _Shared:
    """Shared state of the sockets of a page and camera."""

    viewer: Viewer
    sockets: set[web.WebSocketResponse] = field(default_factory=set[web.WebSocketResponse])


class PictureRoutes:
    """Lists cameras and sends their pictures to pages whose login may see them."""

    def __init__(
        self,
        cameras: Cameras,
        reader: SocketReader,
        holding: Callable[[Principal, web.WebSocketResponse], AbstractContextManager[Any]],
    ) -> None:
        """`holding` closes a socket when its login ends."""
        self.cameras = cameras
        self._reader, self._holding = reader, holding
        self._shared: dict[tuple[str, str], _Shared] = {}

    async def close(self) -> None:
        """Close all sockets, and the session on the bus."""
        sockets = [each for shared in self._shared.values() for each in shared.sockets]
        await asyncio.gather(*(socket.close() for socket in sockets))
        await self.cameras.close()

    async def serve_list(self, request: web.Request) -> web.StreamResponse:
        """Answer `GET cameras` with those that the login may see."""
        names = [each.name for each in self.cameras.feeds.values()]
        names.sort(key=lambda name: (name.robot or "", name.name))
        entries = [
            CameraEntry(name.key, name.name, name.robot)
            for name in names
            if may_see(request[PRINCIPAL].rights, name)
        ]
        return json_response(entries)

    async def serve(
        self, request: web.Request, page: str, principal: Principal
    ) -> web.StreamResponse:
        """Serve a socket of an admitted page.

        Raises:
            web.HTTPNotFound: If there is no such camera, or the login may not see it.
            web.HTTPTooManyRequests: If the page has all its sockets.
        """
        camera = self.cameras.feeds.get(request.query.get("camera", ""))
        if camera is None or not may_see(principal.rights, camera.name):
            raise web.HTTPNotFound(text="No such camera.")
        key = page, camera.name.key
        shared = self._shared.setdefault(key, _Shared(Viewer(camera)))
        if len(shared.sockets) >= MAX_SOCKETS:
            raise web.HTTPTooManyRequests(text=f"A page has at most {MAX_SOCKETS} of these.")
        socket = web.WebSocketResponse(
            compress=False, max_msg_size=256, autoping=False, heartbeat=_HEARTBEAT_S
        )
        shared.sockets.add(socket)
        try:
            await socket.prepare(request)
            with self._holding(principal, socket):
                async with camera.watched():
                    await self._run(request, socket, shared.viewer, principal.key or page)
            await self._reader.close_cut_off(request, socket)
        finally:
            shared.sockets.discard(socket)
            if not shared.sockets:
                self._shared.pop(key, None)
        return socket

    async def _run(
        self, request: web.Request, socket: web.WebSocketResponse, viewer: Viewer, key: str
    ) -> None:
        """Send one picture for each request, until the socket closes."""
        credit = _Credit()
        sending = asyncio.create_task(_send(socket, viewer, credit))
        try:
            async for message in self._reader.messages(request, socket, LIMITS, key):
                if message.type is not WSMsgType.TEXT:
                    continue
                try:
                    asked = msgspec.json.decode(message.data, type=PictureRequest)
                except msgspec.MsgspecError:
                    continue
                if credit.size:
                    now_s = time.monotonic()
                    took_s = now_s - credit.sent_s - 1e-3 * max(asked.held_ms, 0.0)
                    viewer.budget.add(credit.size, took_s, 1e-3 * asked.rtt_ms, now_s)
                    credit.size = 0
                credit.width = min(max(asked.width, 1), _WIDEST)
                credit.stream = (credit.stream or H264Stream()) if asked.h264 else None
                credit.given.set()
        finally:
            sending.cancel()


@dataclass(slots=True)
class _Credit:
    """Credit of a socket, at most one picture, and the latest picture sent."""

    width: int = 1
    sent_s: float = 0.0
    size: int = 0
    """Bytes of a picture that is not acknowledged by the next request."""
    stream: H264Stream | None = None
    """H.264 of this socket, while the page can show it."""
    given: asyncio.Event = field(default_factory=asyncio.Event)


async def _send(socket: web.WebSocketResponse, viewer: Viewer, credit: _Credit) -> None:
    with contextlib.suppress(ConnectionError):
        while True:
            await credit.given.wait()
            picture = await viewer.next(credit.width, credit.stream)
            credit.given.clear()
            credit.sent_s, credit.size = time.monotonic(), len(picture)
            await socket.send_bytes(picture)


def may_see(rights: RobotRights, camera: CameraName) -> bool:
    """Return whether a login may see a camera: on a robot that it watches, or of all robots."""
    if camera.robot is None:
        return ALL in rights.visible
    return rights.may_watch(camera.robot)
