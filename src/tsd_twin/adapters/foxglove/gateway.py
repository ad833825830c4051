"""Gateway of `tsd-foxglove`: the WebSocket server for clients.

It checks `Host`, `Origin` and token, limits client messages, and forwards everything except
commands to the SDK. Publications and service calls go directly to the client's operator, so that
commands never wait in a queue. Pings bound the age of messages: any message received after a pong
was sent after the corresponding ping.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
import ssl
import statistics
import struct
import time
from collections import deque
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass, field
from typing import Any

import aiohttp
import msgspec
from aiohttp import WSMsgType, web

from tsd_twin.adapters.foxglove.live import LiveOperator
from tsd_twin.adapters.foxglove.sdk import LOOPBACK, SUBPROTOCOL
from tsd_twin.errors import TwinError
from tsd_twin.security.web_access import is_loopback, origin_refusal

_LOG = logging.getLogger(__name__)
FOXGLOVE_ORIGIN = "https://app.foxglove.dev"
"""Origin of Foxglove's web application."""
MOST_CLIENTS = 16
PING_S = 0.02
"""Ping period, which adds to the round trip as uncertainty of the message age."""
SILENT_S = 2.0
"""Clients that answer no ping for this time are disconnected, and their robot stops."""
LARGEST_BYTES = 64 * 2**10
"""Maximum message size; larger messages close the connection."""
MOST_MESSAGES, MOST_BYTES = 1000, 512 * 2**10
"""Maximum messages and bytes per client and second; more close the connection."""
MOST_CHANNELS = 64
"""Maximum channels that a client may publish on simultaneously."""
_TRIPS = 50
_MOST_CALLS = 32
_MOST_SENTENCES = 64
_CLOSE_S = 1.0
_SHUTDOWN_S = 3.0
_LARGEST_ASSET_BYTES = 64 * 2**20
_PUBLISH, _CALL, _RESPONSE = 1, 2, 3
"""Binary operations of the protocol."""
_INFO, _ERROR = 0, 2


@dataclass(frozen=True, slots=True)
class Access:
    """Access settings of the server."""

    token: str | None = None
    """Secret that clients must present, if any."""
    tls: ssl.SSLContext | None = None
    allowed_hosts: Collection[str] = ()
    """Accepted values of `Host`, in addition to this machine's names."""
    origins: Collection[str] = (FOXGLOVE_ORIGIN,)
    """Origins of other sites that may connect."""

    def check(self, host: str) -> None:
        """Reject settings that admit other machines without a token or expose the token.

        Raises:
            TwinError: If the settings are unsafe.
        """
        if is_loopback(host):
            return
        if self.token is None:
            raise TwinError(
                f"{host} can be reached by other machines: name the token that clients have to "
                "bring with --token-file FILE, which is made if there is none"
            )
        if self.tls is None:
            raise TwinError(
                f"the token would cross the network for everybody to read: {host} needs "
                "--tls-cert and --tls-key"
            )

    def refusal(self, request: web.Request, host: str, port: int) -> web.HTTPException | None:
        """Return the error response for a request, or None if it may connect."""
        secure = self.tls is not None
        names = {*self.allowed_hosts, *(f"{name}:{port}" for name in self.allowed_hosts)}
        host_header = ", ".join(request.headers.getall("Host", []))
        reason = origin_refusal(
            host_header, None, port, names, addresses=not is_loopback(host), secure=secure
        )
        if reason is not None:
            return web.HTTPForbidden(text=_readable(reason))
        origin = ", ".join(request.headers.getall("Origin", []))
        if origin and origin.lower() not in {each.lower() for each in self.origins}:
            reason = f"A page of {origin[:200]} may not connect: --allow-origin names another site."
            return web.HTTPForbidden(text=_readable(reason))
        if self.token is not None and not hmac.compare_digest(
            _token_of(request).encode(errors="surrogateescape"), self.token.encode()
        ):
            return web.HTTPUnauthorized(text="The token is wrong, or missing: ?token=...")
        offered = ",".join(request.headers.getall("Sec-WebSocket-Protocol", []))
        if SUBPROTOCOL not in {each.strip() for each in offered.split(",")}:
            return web.HTTPBadRequest(text=f"Only the protocol {SUBPROTOCOL} is spoken here.")
        return None


def _readable(text: str) -> str:
    """Make text encodable; aiohttp keeps header bytes that are not UTF-8."""
    return text.encode(errors="replace").decode()


def _token_of(request: web.Request) -> str:
    bearer = request.headers.get("Authorization", "")
    if bearer.startswith("Bearer "):
        return bearer.removeprefix("Bearer ").strip()
    return request.query.get("token", "")


MakeOperator = Callable[[Callable[[str], None], Callable[[], float]], LiveOperator]
"""Creates a client's operator, given functions that send it a notice and return its RTT."""


class _ClientChannel(msgspec.Struct, frozen=True):
    id: int
    topic: str
    encoding: str
    schemaName: str = ""  # noqa: N815  Name defined by the protocol.


class _Operation(msgspec.Struct, frozen=True):
    op: str
    channels: msgspec.Raw = msgspec.Raw(b"null")
    """Channels in an `advertise` message."""
    channelIds: msgspec.Raw = msgspec.Raw(b"null")  # noqa: N815  Name defined by the protocol.
    """Ids in an `unadvertise` message."""


@dataclass(slots=True)
class Front:
    """Server for clients."""

    access: Access
    make_operator: MakeOperator | None
    """Creates operators; None if nothing can be driven."""
    sdk_port: int
    trust: ssl.SSLContext
    """Trusts the certificate of the SDK's port."""
    host: str = LOOPBACK
    port: int = 0
    _runner: web.AppRunner | None = None
    _clients: set[_Client] = field(default_factory=set["_Client"])

    async def start(self, host: str, port: int) -> None:
        """Start listening; port 0 picks a free one.

        Raises:
            TwinError: If the port is in use or the settings are unsafe.
        """
        self.access.check(host)
        app = web.Application(client_max_size=1024)
        app.router.add_get("/", self._serve)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=_SHUTDOWN_S)
        await runner.setup()
        site = web.TCPSite(runner, host, port, ssl_context=self.access.tls)
        try:
            await site.start()
        except OSError as error:
            await runner.cleanup()
            raise TwinError(f"port {port} of {host} cannot be used: choose another") from error
        self._runner, self.host = runner, host
        self.port = runner.addresses[0][1]

    async def stop(self) -> None:
        """Close all connections, which stops their robots, and stop listening."""
        for client in list(self._clients):
            await client.end(aiohttp.WSCloseCode.GOING_AWAY, "tsd-foxglove ends")
        if self._runner is not None:
            await self._runner.cleanup()

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        refusal = self.access.refusal(request, self.host, self.port)
        if refusal is None and len(self._clients) >= MOST_CLIENTS:
            refusal = web.HTTPServiceUnavailable(text=f"{MOST_CLIENTS} clients are connected.")
        if refusal is not None:
            _LOG.warning("a connection is refused: %s", refusal.text)
            raise refusal
        socket = web.WebSocketResponse(
            protocols=(SUBPROTOCOL,),
            compress=False,
            max_msg_size=LARGEST_BYTES,
            autoping=False,
            timeout=0.5,
        )
        client = _Client(socket)
        self._clients.add(client)
        try:
            await socket.prepare(request)
            url = f"wss://{LOOPBACK}:{self.sdk_port}/"
            async with (
                aiohttp.ClientSession() as session,
                session.ws_connect(
                    url,
                    protocols=(SUBPROTOCOL,),
                    ssl=self.trust,
                    max_msg_size=_LARGEST_ASSET_BYTES,
                    compress=0,
                ) as inner,
            ):
                await client.run(inner, self.make_operator)
        finally:
            self._clients.discard(client)
        return socket


class _Client:
    """Connection of a client."""

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._wrapped: aiohttp.ClientWebSocketResponse | None = None
        self._operator: LiveOperator | None = None
        self._second_s, self._messages, self._bytes = 0.0, 0, 0
        self._channels: dict[int, _ClientChannel] = {}
        self._services: dict[int, str] = {}
        self._calls: set[asyncio.Task[None]] = set()
        self._notices: set[asyncio.Task[None]] = set()
        self._pings: deque[tuple[bytes, float]] = deque(maxlen=256)
        self._trips_s: deque[float] = deque(maxlen=_TRIPS)
        self._sent_after_s = self._answered_s = time.monotonic()

    async def run(
        self, inner: aiohttp.ClientWebSocketResponse, make_operator: MakeOperator | None
    ) -> None:
        """Serve until one side closes; then the client's operator releases its robots."""
        self._wrapped = inner
        if make_operator is not None:
            self._operator = make_operator(self.say, self.trip_s)
        # Pings can be stuck behind unread data, so a separate task watches for silence.
        works = (self._from_client(), self._from_sdk(inner), self._ping(), self._until_silent())
        tasks = [asyncio.create_task(work) for work in works]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            tasks += self._calls | self._notices
            for task in tasks:
                task.cancel()
            for result in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(result, Exception) and not isinstance(result, ConnectionError):
                    _LOG.error("a connection has failed", exc_info=result)
            if self._operator is not None:
                await self._operator.close()
            await self.end(aiohttp.WSCloseCode.GOING_AWAY, "")

    def trip_s(self) -> float:
        """Return the median round-trip time of recent pings, or 0 if unknown."""
        return statistics.median(self._trips_s) if self._trips_s else 0.0

    async def end(self, code: int, reason: str) -> None:
        """Close the connection."""
        with contextlib.suppress(ConnectionError, RuntimeError, TimeoutError):
            async with asyncio.timeout(_CLOSE_S):
                await self._socket.close(code=code, message=reason.encode())

    def say(self, text: str, level: int = _INFO + 1) -> None:
        """Send a notice, which the client's application shows."""
        self._send_json({"op": "status", "level": level, "message": text})

    # Client to server.

    async def _from_client(self) -> None:
        async for message in self._socket:
            now_s = time.monotonic()
            if message.type is WSMsgType.ERROR:
                return  # The message was too long or malformed; aiohttp closes the connection.
            if not self._is_within_limits(len(message.data or b""), now_s):
                await self.end(aiohttp.WSCloseCode.POLICY_VIOLATION, "too many messages")
                return
            if message.type is WSMsgType.PONG:
                self._on_pong(bytes(message.data), now_s)
            elif message.type is WSMsgType.PING:
                await self._socket.pong(message.data)
            elif message.type is WSMsgType.TEXT:
                await self._on_text(message.data)
            elif message.type is WSMsgType.BINARY:
                await self._on_binary(message.data)

    def _is_within_limits(self, size: int, now_s: float) -> bool:
        """Count a message of the current second."""
        if now_s - self._second_s >= 1.0:
            self._second_s, self._messages, self._bytes = now_s, 0, 0
        self._messages += 1
        self._bytes += size
        return self._messages <= MOST_MESSAGES and self._bytes <= MOST_BYTES

    def _on_pong(self, data: bytes, now_s: float) -> None:
        # Ignore unsolicited pongs.
        at = next((i for i, (sent, _) in enumerate(self._pings) if sent == data), None)
        if at is not None:
            self._sent_after_s, self._answered_s = self._pings[at][1], now_s
            self._trips_s.append(now_s - self._sent_after_s)
            for _ in range(at + 1):
                self._pings.popleft()

    async def _on_text(self, text: str) -> None:
        assert self._wrapped is not None  # noqa: S101  `run` has set it.
        try:
            operation = msgspec.json.decode(text, type=_Operation)
            if operation.op == "advertise" and self._operator is not None:
                self._advertise(msgspec.json.decode(operation.channels, type=list[_ClientChannel]))
                return
            if operation.op == "unadvertise" and self._operator is not None:
                for number in msgspec.json.decode(operation.channelIds, type=list[int]):
                    self._channels.pop(number, None)
                return
        except (msgspec.DecodeError, RecursionError) as error:
            self.say(f"this is no message of the protocol: {error}", _ERROR)
            return
        await self._wrapped.send_str(text)

    def _advertise(self, channels: list[_ClientChannel]) -> None:
        for channel in channels:
            if len(self._channels) >= MOST_CHANNELS:
                self.say(f"{MOST_CHANNELS} channels are advertised already", _ERROR)
                return
            self._channels[channel.id] = channel

    async def _on_binary(self, data: bytes) -> None:
        assert self._wrapped is not None  # noqa: S101  `run` has set it.
        if data[:1] == bytes([_PUBLISH]):
            self._on_publish(data)
        elif data[:1] == bytes([_CALL]):
            self._on_call(data)
        else:
            await self._wrapped.send_bytes(data)

    def _on_publish(self, data: bytes) -> None:
        number = int.from_bytes(data[1:5], "little")
        channel = self._channels.get(number)
        if self._operator is None or channel is None or len(data) < 5:
            self.say(f"nothing is advertised as channel {number}", _ERROR)
            return
        self._operator.publish(
            channel.topic, channel.encoding, channel.schemaName, data[5:], self._sent_after_s
        )

    def _on_call(self, data: bytes) -> None:
        if self._operator is None or len(data) < 13:
            return
        service, call, length = struct.unpack_from("<III", data, 1)
        encoding = data[13 : 13 + length]
        name = self._services.get(service)
        if name is None:
            self._fail(service, call, "there is no such service")
        elif encoding != b"json":
            self._fail(service, call, "services take JSON")
        elif len(self._calls) >= _MOST_CALLS and not name.endswith("/stop"):
            self._fail(service, call, "too many calls are under way")
        else:
            self._later(self._answer(service, call, self._operator.call(name)), self._calls)

    async def _answer(self, service: int, call: int, work: Awaitable[tuple[bool, str]]) -> None:
        done, text = await work
        body = msgspec.json.encode({"success": done, "message": text})
        head = struct.pack("<BIII", _RESPONSE, service, call, 4)
        await self._socket.send_bytes(head + b"json" + body)

    def _fail(self, service: int, call: int, text: str) -> None:
        failure = {"op": "serviceCallFailure", "serviceId": service, "callId": call}
        self._send_json({**failure, "message": text})

    def _send_json(self, message: dict[str, object]) -> None:
        if len(self._notices) < _MOST_SENTENCES:  # Otherwise the client is not reading.
            text = msgspec.json.encode(message).decode()
            self._later(self._socket.send_str(text), self._notices)

    # Server to client.

    async def _from_sdk(self, inner: aiohttp.ClientWebSocketResponse) -> None:
        async for message in inner:
            if message.type is WSMsgType.TEXT:
                self._learn(message.data)
                await self._socket.send_str(message.data)
            elif message.type is WSMsgType.BINARY:
                await self._socket.send_bytes(message.data)

    def _learn(self, text: str) -> None:
        """Record the ids of services sent to the client."""
        message = msgspec.json.decode(text)
        if message["op"] == "advertiseServices":
            self._services.update({each["id"]: each["name"] for each in message["services"]})

    async def _ping(self) -> None:
        for number in range(1, 2**62):
            data = struct.pack("<Q", number)
            self._pings.append((data, time.monotonic()))
            await self._socket.ping(data)
            await asyncio.sleep(PING_S)

    async def _until_silent(self) -> None:
        while time.monotonic() - self._answered_s < SILENT_S:
            await asyncio.sleep(PING_S)

    def _later(self, work: Awaitable[Any], tasks: set[asyncio.Task[None]]) -> None:
        async def run() -> None:
            with contextlib.suppress(ConnectionError, RuntimeError):  # The client has disconnected.
                await work

        task = asyncio.create_task(run())
        tasks.add(task)
        task.add_done_callback(tasks.discard)
