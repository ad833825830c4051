"""Per-socket limits on the rate and size of input.

Messages are checked before they are decoded, and all sockets get equal receive time.
"""

from __future__ import annotations

import asyncio
import logging
import re
import socket as sockets
import time
from collections.abc import AsyncGenerator, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from types import MappingProxyType

from aiohttp import WSMessage, WSMsgType, web

from tsd_twin.dashboard.gateway.connection_limits import limit_bytes
from tsd_twin.dashboard.scene.themed import RateLimiter

POLICY_VIOLATION = 1008
"""Close code of a flooding socket."""
TOO_MUCH = "too many messages: this socket is closed"
"""Close reason of a flooding socket."""
GRACE = 2.0
"""A socket is closed when its token level falls below minus this many bursts."""
_ON_THE_WIRE = 2.0
"""Bytes on the wire per byte of the shortest messages; the frame header has six bytes."""
_KIND = re.compile(r'\s*\{\s*"t"\s*:\s*"([a-z_]{1,20})"')
_NEVER_DROPPED = frozenset({"stop", "release"})
"""Kinds that can only stop the robot."""
_SHORT = 64
"""Length in characters that both of them stay below."""


class LimitDecision(Enum):
    """Decision of a limiter on a message."""

    PASS = auto()
    DROP = auto()
    CUT = auto()
    """The socket floods and must be closed."""


@dataclass(frozen=True, slots=True)
class Quota:
    """Average rate and burst size of a token bucket."""

    per_s: float
    burst: float


class Bucket:
    """Token bucket with time as an argument; its level may become negative."""

    def __init__(self, quota: Quota) -> None:
        self._quota = quota
        self._left = quota.burst
        self._at_s = 0.0

    def take(self, amount: float, now_s: float) -> float:
        """Take tokens and return the level, which may be negative."""
        refill = max(0.0, now_s - self._at_s) * self._quota.per_s
        self._left = min(self._quota.burst, self._left + refill) - amount
        self._at_s = now_s
        return self._left

    def try_take(self, now_s: float) -> bool:
        """Take one token if available."""
        if self.take(1.0, now_s) >= 0.0:
            return True
        self._left += 1.0
        return False


@dataclass(frozen=True, slots=True)
class SocketLimits:
    """Rate and size limits of a socket."""

    messages: Quota
    size: Quota
    """In characters or bytes."""
    kinds: Mapping[str, Quota]
    """Additional limits per kind of text message."""
    other: Quota
    """Limit of text messages of unknown kind or without their own limit."""

    @property
    def on_the_wire(self) -> Quota:
        """Limit of raw bytes, above the level at which whole messages close the socket."""
        size = self.size
        return Quota(_ON_THE_WIRE * size.per_s, _ON_THE_WIRE * (1.0 + GRACE) * size.burst)


TELEOP = SocketLimits(
    messages=Quota(200.0, 400.0),
    size=Quota(64e3, 192e3),
    kinds=MappingProxyType(
        {
            # A page sends at most 100 of the motions and 10 heartbeats per second.
            "drive": Quota(150.0, 300.0),
            "follow_plan": Quota(150.0, 300.0),
            "heartbeat": Quota(30.0, 100.0),
            "preview": Quota(150.0, 300.0),
            "plan": Quota(10.0, 20.0),
            "speed_level": Quota(30.0, 60.0),
            "clear_plan": Quota(10.0, 30.0),
            "lease": Quota(10.0, 60.0),
            "arm": Quota(10.0, 60.0),
            "disarm": Quota(10.0, 60.0),
            "reset": Quota(10.0, 60.0),
            "wheel_speed": Quota(20.0, 40.0),
            "robot": Quota(10.0, 60.0),
            "plot_fields": Quota(5.0, 30.0),
            "view": Quota(5.0, 30.0),
            "map": Quota(5.0, 30.0),
            "fleet": Quota(5.0, 30.0),
            "name": Quota(1.0, 10.0),
            "look_back": Quota(30.0, 60.0),
            "seek": Quota(30.0, 60.0),
            "step": Quota(30.0, 60.0),
            "mark": Quota(1.0, 10.0),
            "student": Quota(20.0, 40.0),
        }
    ),
    other=Quota(50.0, 300.0),
)
"""Limits of the control socket."""
VISER = SocketLimits(
    messages=Quota(120.0, 300.0), size=Quota(64e3, 256e3), kinds={}, other=Quota(120.0, 300.0)
)
"""Limits of viser's socket; its page sends at most 50 camera and 20 control changes per second."""


class SocketLimiter:
    """Rate limiter of a socket; dropped messages count too."""

    def __init__(self, limits: SocketLimits) -> None:
        self._limits = limits
        self._messages, self._size = Bucket(limits.messages), Bucket(limits.size)
        self._kinds: dict[str, Bucket] = {}
        self.dropped = 0
        """Number of messages dropped without decoding."""

    def decide(self, data: str | bytes, now_s: float) -> LimitDecision:
        """Decide on a message from its length and first characters."""
        found = _KIND.match(data) if isinstance(data, str) else None
        kind = "" if found is None else found[1]
        left = self._messages.take(1.0, now_s) / self._limits.messages.burst
        left = min(left, self._size.take(float(len(data)), now_s) / self._limits.size.burst)
        if left < -GRACE:
            return LimitDecision.CUT
        if kind in _NEVER_DROPPED and len(data) <= _SHORT:
            return LimitDecision.PASS
        if left < 0.0 or not self._bucket(kind).try_take(now_s):
            self.dropped += 1
            return LimitDecision.DROP
        return LimitDecision.PASS

    def _bucket(self, kind: str) -> Bucket:
        quota = self._limits.kinds.get(kind)
        name = "" if quota is None else kind
        if name not in self._kinds:
            self._kinds[name] = Bucket(quota or self._limits.other)
        return self._kinds[name]


class FloodBlocklist:
    """Block list of logins and pages whose socket was closed for flooding.

    The block time doubles if a client floods again within a minute.
    """

    STAYS_OUT_S = 5.0
    LONGEST_S = 60.0
    _MOST = 1000

    def __init__(self) -> None:
        self._out: dict[str, tuple[float, float]] = {}
        """Block duration and end time by key."""
        self.count = 0
        """Number of sockets closed so far."""

    def note(self, key: str, now_s: float) -> None:
        """Add a login or page whose socket flooded."""
        self.count += 1
        recent = now_s - self.LONGEST_S
        self._out = {who: out for who, out in self._out.items() if out[1] > recent}
        before_s, until_s = self._out.pop(key, (0.0, 0.0))
        while len(self._out) >= self._MOST:
            del self._out[next(iter(self._out))]
        if until_s > now_s:  # The client flooded on another socket that was already open.
            self._out[key] = (before_s, until_s)
            return
        stays_s = min(max(self.STAYS_OUT_S, 2.0 * before_s), self.LONGEST_S)
        self._out[key] = (stays_s, now_s + stays_s)

    def waits_s(self, key: str, now_s: float) -> float:
        """Return the remaining block time; 0 if a new socket is allowed."""
        return max(0.0, self._out.get(key, (0.0, 0.0))[1] - now_s)


_LOG = logging.getLogger(__name__)

TURN = 24
"""Maximum number of messages per socket in one iteration of the event loop."""
_IN_A_ROW_S = 0.002
"""Maximum interval between two messages read without waiting."""
_RECEIVE_BYTES = 32 * 2**10
"""Receive buffer of a socket, which bounds the data parsed in one iteration of the loop."""
_GOODBYE_S = 0.2
"""Time for the close frame to arrive before the connection is reset."""
_REFUSED_AFTER_S = 1.0
_REFUSING = 100
"""Maximum number of delayed refusals; further ones are sent immediately."""
_HUNG_UP = web.RequestKey("_HUNG_UP", bool)
"""Whether the request's socket was closed for flooding."""
_ENDS = (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED, WSMsgType.ERROR)


class SocketReader:
    """Reader of the sockets of all pages; event loop only."""

    def __init__(self) -> None:
        self.cut_off = FloodBlocklist()
        """Block list of flooding clients."""
        self.dropped = 0
        """Number of messages dropped because of a limit."""
        self._says = RateLimiter(0.1)
        self._refusing = 0

    async def admit(self, request: web.Request, key: str) -> None:
        """Refuse a new socket of a blocked login or page; otherwise limit its receive buffer.

        Raises:
            web.HTTPTooManyRequests: If the login or page is blocked.
        """
        if (wait_s := self.cut_off.waits_s(key, time.monotonic())) > 0.0:
            if self._refusing < _REFUSING:
                # Delay clients that retry after each response, which would keep the loop busy.
                self._refusing += 1
                try:
                    await asyncio.sleep(min(wait_s, _REFUSED_AFTER_S))
                finally:
                    self._refusing -= 1
            raise web.HTTPTooManyRequests(
                text=f"Too many messages came from here: wait {wait_s:.0f} s.",
                headers={"Retry-After": str(int(wait_s) + 1)},
            )
        # Parsing much data at once delays other sockets.
        limit_buffer(request.get_extra_info("socket"), sockets.SO_RCVBUF, _RECEIVE_BYTES)

    async def messages(
        self, request: web.Request, socket: web.WebSocketResponse, limits: SocketLimits, key: str
    ) -> AsyncGenerator[WSMessage]:
        """Yield the accepted messages of a socket until it closes or floods, which blocks `key`.

        Disable the automatic pong of `socket`, which would hide a flood of pings.
        """
        limiter = SocketLimiter(limits)
        wire = Bucket(limits.on_the_wire)

        def exceeds(count: int) -> bool:
            if wire.take(float(count), time.monotonic()) >= 0.0:
                return False
            self._note(key)
            return True

        limit_bytes(request, exceeds)
        in_a_row, before_s = 0, 0.0
        while True:
            if in_a_row >= TURN:
                in_a_row = 0
                await asyncio.sleep(0.0)  # `receive` does not yield while messages are buffered.
            message = await socket.receive()
            now_s = time.monotonic()
            in_a_row = in_a_row + 1 if now_s - before_s < _IN_A_ROW_S else 0
            before_s = now_s
            if message.type in _ENDS:
                return
            data = message.data if isinstance(message.data, str | bytes) else bytes(message.data)
            decision = limiter.decide(data, now_s)
            if decision is LimitDecision.CUT:
                self._note(key)
                _stop_reading(request)
                return
            if decision is LimitDecision.DROP:
                self.dropped += 1
            elif message.type is WSMsgType.PING:
                await socket.pong(data if isinstance(data, bytes) else data.encode())
            elif message.type is not WSMsgType.PONG:
                yield message

    def _note(self, key: str) -> None:
        now_s = time.monotonic()
        self.cut_off.note(key, now_s)
        if self._says.is_due(now_s):
            _LOG.warning("a page that flooded was cut off, the %d. so far", self.cut_off.count)

    async def close_cut_off(self, request: web.Request, socket: web.WebSocketResponse) -> None:
        """Close a flooding socket with code and reason, without reading further."""
        transport = request.transport
        if not request.get(_HUNG_UP, False) or transport is None:
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


def _stop_reading(request: web.Request) -> None:
    request[_HUNG_UP] = True
    if isinstance(request.transport, asyncio.ReadTransport):
        request.transport.pause_reading()


def limit_buffer(connection: sockets.socket | None, option: int, size: int) -> None:
    """Set the size of a send or receive buffer in bytes."""
    if connection is not None:
        connection.setsockopt(sockets.SOL_SOCKET, option, size)
