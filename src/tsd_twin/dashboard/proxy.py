"""viser's own socket, passed through: viser listens on the loopback only, and checks nobody."""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager

from aiohttp import (
    ClientError,
    ClientSession,
    ClientWebSocketResponse,
    WSMessage,
    WSMsgType,
    web,
)

from tsd_twin.access import Role
from tsd_twin.dashboard.allowance import VISER
from tsd_twin.dashboard.ear import Ear
from tsd_twin.dashboard.viser_filter import LARGEST_BYTES, passed
from tsd_twin.dashboard.viser_key import KEY_HEADER, key
from tsd_twin.dashboard.viser_private import (
    DARK_HEADER,
    PAGE_HEADER,
    PLAIN_HEADER,
    ROLE_HEADER,
)
from tsd_twin.dashboard.visitor import Visitor
from tsd_twin.errors import MessageError

PAGE = re.compile(r"[0-9a-f]{16}")
"""A page id: made by the page itself, and good for nothing else."""

_FROM_VISER = 64 * 2**20
_SOCKET_BUFFER = 128 * 2**10
"""Bytes: by default the kernel holds 2 MB for a slow page, which is many seconds of old poses."""
_HEARTBEAT_S = 10.0
_GOODBYE_S = 0.5


class ViserProxy:
    """Connects each page's `viser/<page>` to the viser server."""

    def __init__(self, viser_port: int, ear: Ear) -> None:
        self.dropped = 0
        """Messages of pages that were not passed on."""
        self._ear = ear
        self._url = f"ws://127.0.0.1:{viser_port}/"
        self._client: ClientSession | None = None
        self._open: set[web.WebSocketResponse] = set()

    async def close(self) -> None:
        """Close all sockets."""
        await asyncio.gather(
            *(page.close(code=1001, message=b"the dashboard ends") for page in self._open)
        )
        if self._client is not None:
            await self._client.close()

    async def serve(
        self,
        request: web.Request,
        page_id: str,
        visitor: Visitor,
        holding: Callable[[web.WebSocketResponse], AbstractContextManager[None]],
    ) -> web.StreamResponse:
        """Answer `GET viser/<page>`; the page's socket is open within `holding` it."""
        if self._client is None:
            self._client = ClientSession()
        offered = request.headers.get("Sec-WebSocket-Protocol", "")
        protocols = [name.strip() for name in offered.split(",") if name.strip()]
        try:
            viser = await self._client.ws_connect(
                self._url,
                protocols=protocols,
                headers={
                    KEY_HEADER: key(),
                    PAGE_HEADER: page_id,
                    ROLE_HEADER: visitor.identity.role,
                    DARK_HEADER: _looks(request, "dark"),
                    PLAIN_HEADER: _looks(request, "plain"),
                },
                compress=0,
                max_msg_size=_FROM_VISER,
            )
        except (ClientError, OSError) as error:
            raise web.HTTPServiceUnavailable(text=f"viser does not answer: {error}") from error
        async with viser:
            chosen = (viser.protocol,) if viser.protocol else ()
            page = web.WebSocketResponse(
                timeout=_GOODBYE_S,
                protocols=chosen,
                compress=False,
                max_msg_size=LARGEST_BYTES,
                heartbeat=_HEARTBEAT_S,
                autoping=False,
            )
            await page.prepare(request)
            _bound(request.get_extra_info("socket"), socket.SO_SNDBUF)
            _bound(viser.get_extra_info("socket"), socket.SO_RCVBUF)
            self._open.add(page)
            try:
                with holding(page):
                    messages = self._ear.messages(request, page, VISER, visitor.key or page_id)
                    await self._connect(request, page, viser, messages, visitor.identity.role)
            finally:
                self._open.discard(page)
        return page

    async def _connect(
        self,
        request: web.Request,
        page: web.WebSocketResponse,
        viser: ClientWebSocketResponse,
        messages: AsyncIterator[WSMessage],
        role: Role,
    ) -> None:
        """Pass messages both ways until either side ends, then end the other."""
        ways = [
            asyncio.create_task(self._pass_checked(messages, viser, role)),
            asyncio.create_task(_pass(viser, page)),
        ]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            await self._ear.say_goodbye(request, page)
            # viser tells a client of another version why it is refused.
            await page.close(code=viser.close_code or 1001)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_GOODBYE_S):
                    await viser.close()

    async def _pass_checked(
        self, messages: AsyncIterator[WSMessage], sink: ClientWebSocketResponse, role: Role
    ) -> None:
        """Pass on what a page may say, until it says something that no page says."""
        with contextlib.suppress(ConnectionError, MessageError):
            async for message in messages:
                if message.type is not WSMsgType.BINARY:
                    return
                if (frame := passed(message.data, role)) is not None:
                    await sink.send_bytes(frame)
                else:
                    self.dropped += 1


def _looks(request: web.Request, word: str) -> str:
    return "1" if word in request.query.get("look", "").split("-") else "0"


async def _pass(source: ClientWebSocketResponse, sink: web.WebSocketResponse) -> None:
    """Pass messages on, one at a time: a slow reader slows its writer, and nothing piles up."""
    with contextlib.suppress(ConnectionError):
        async for message in source:
            if message.type is WSMsgType.BINARY:
                await sink.send_bytes(message.data)


def _bound(connection: socket.socket | None, option: int) -> None:
    if connection is not None:
        connection.setsockopt(socket.SOL_SOCKET, option, _SOCKET_BUFFER)
