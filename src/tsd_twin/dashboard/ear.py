"""Receives from one socket of a page: fairly beside the others, and no more than it may send."""

from __future__ import annotations

import asyncio
import logging
import socket as sockets
import time
from collections.abc import AsyncGenerator

from aiohttp import WSMessage, WSMsgType, web

from tsd_twin.dashboard.allowance import (
    POLICY_VIOLATION,
    TOO_MUCH,
    Allowance,
    CutOff,
    Limits,
    Verdict,
)
from tsd_twin.dashboard.rate import Rate

_LOG = logging.getLogger(__name__)

TURN = 24
"""Messages of one socket in one turn of the event loop."""
_IN_A_ROW_S = 0.002
"""Between two messages that were read without waiting in between."""
_RECEIVE_BYTES = 32 * 2**10
"""What the kernel holds for one socket, and so what is parsed of it in one turn of the loop."""
_GOODBYE_S = 0.2
"""For the close frame to arrive before the connection is reset."""
_REFUSED_AFTER_S = 1.0
_REFUSING = 100
"""Refusals that wait at a time; more are answered at once, so that nothing piles up."""
_ENDS = (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED, WSMsgType.ERROR)


class Ear:
    """Listens to the sockets of all pages; belongs to the event loop."""

    def __init__(self) -> None:
        self.cut_off = CutOff()
        """Who flooded."""
        self.dropped = 0
        """Messages beyond what a socket may send."""
        self._says = Rate(0.1)
        self._refusing = 0

    async def admit(self, request: web.Request, key: str) -> None:
        """Refuse a new socket to a login or a page that has just flooded; prepare it otherwise.

        Raises:
            web.HTTPTooManyRequests: it has to wait.
        """
        if (wait_s := self.cut_off.waits_s(key, time.monotonic())) > 0.0:
            if self._refusing < _REFUSING:
                # Who asks again after each answer must not keep the loop busy by that.
                self._refusing += 1
                try:
                    await asyncio.sleep(min(wait_s, _REFUSED_AFTER_S))
                finally:
                    self._refusing -= 1
            raise web.HTTPTooManyRequests(
                text=f"Too many messages came from here: wait {wait_s:.0f} s.",
                headers={"Retry-After": str(int(wait_s) + 1)},
            )
        hold_little(request)

    async def messages(
        self, request: web.Request, socket: web.WebSocketResponse, limits: Limits, key: str
    ) -> AsyncGenerator[WSMessage]:
        """Yield what a socket may say, until it ends, or floods: then `key` stays out for a while.

        `socket` must not answer pings by itself: a flood of them would never come here.
        """
        allowance = Allowance(limits)
        in_a_row, before_s = 0, 0.0
        while True:
            if in_a_row >= TURN:
                in_a_row = 0
                await asyncio.sleep(0.0)  # `receive` does not wait while something is there.
            message = await socket.receive()
            now_s = time.monotonic()
            in_a_row = in_a_row + 1 if now_s - before_s < _IN_A_ROW_S else 0
            before_s = now_s
            if message.type in _ENDS:
                return
            data = message.data if isinstance(message.data, str | bytes) else bytes(message.data)
            verdict = allowance.judge(data, now_s)
            if verdict is Verdict.CUT:
                self._note(key)
                hang_up(request)
                return
            if verdict is Verdict.DROP:
                self.dropped += 1
            elif message.type is WSMsgType.PING:
                await socket.pong(data if isinstance(data, bytes) else data.encode())
            elif message.type is not WSMsgType.PONG:
                yield message

    def _note(self, key: str) -> None:
        now_s = time.monotonic()
        self.cut_off.note(key, now_s)
        if self._says.due(now_s):
            _LOG.warning("a page that flooded was cut off, the %d. so far", self.cut_off.count)

    async def say_goodbye(self, request: web.Request, socket: web.WebSocketResponse) -> None:
        """Close a socket that was cut off, with code and reason, without reading on."""
        transport = request.transport
        if not is_hung_up(request) or transport is None:
            return
        payload = POLICY_VIOLATION.to_bytes(2, "big") + TOO_MUCH.encode()
        try:
            async with asyncio.timeout(_GOODBYE_S):
                await socket.send_frame(payload, WSMsgType.CLOSE)
            await asyncio.sleep(_GOODBYE_S)
        except (ConnectionError, TimeoutError):
            pass
        finally:
            transport.abort()


_HUNG_UP = web.RequestKey("_HUNG_UP", bool)


def hang_up(request: web.Request) -> None:
    """Read nothing more from the connection of a request."""
    request[_HUNG_UP] = True
    transport = request.transport
    if isinstance(transport, asyncio.ReadTransport):
        transport.pause_reading()


def is_hung_up(request: web.Request) -> bool:
    """Tell whether its socket was cut off."""
    return request.get(_HUNG_UP, False)


def hold_little(request: web.Request) -> None:
    """Let the kernel hold little for a socket: what is parsed in one turn delays all others."""
    connection = request.get_extra_info("socket")
    if connection is not None:
        connection.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, _RECEIVE_BYTES)
