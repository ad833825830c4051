"""Relays of TCP connections and UDP datagrams over an emulated link."""

from __future__ import annotations

import abc
import asyncio
import contextlib
import enum
import logging
import socket
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TypeAlias, cast

from tsd_twin.link_emulation.channel import Address, LinkChannel, bound, datagrams, resolved
from tsd_twin.link_emulation.link import Segment, Stream
from tsd_twin.link_emulation.spec import Endpoint

SEGMENT_BYTES = 1400
"""Maximum data per segment: an Ethernet frame minus headers, options and a tunnel."""
TCP_HEADER_BYTES = 40
"""IPv4 and TCP headers, which use bandwidth too."""
WINDOW_BYTES = 256 * 1024
"""Data in flight and queued in one direction at which the relay stops reading."""
KERNEL_BYTES = 64 * 1024
"""Kernel buffer of a relay socket; by default the kernel may grow it to megabytes."""
_LINGER_NONE = struct.pack("ii", 1, 0)  # Closing sends a reset.


class ControlSegment(enum.Enum):
    """Control segment of a stream, without data."""

    OPEN = enum.auto()
    END = enum.auto()
    RESET = enum.auto()


SocketPayload: TypeAlias = bytes | ControlSegment
TcpSegment: TypeAlias = Segment[SocketPayload]


class RelaySocket(asyncio.Protocol, abc.ABC):
    """Socket of a relayed TCP connection and the stream of its data to the other side."""

    other: RelaySocket

    def __init__(self, channel: LinkChannel[TcpSegment], sides: set[RelaySocket]) -> None:
        self._channel = channel
        self._stream: Stream[SocketPayload] = Stream(channel.link, self._hand_over)
        self._transport: asyncio.Transport | None = None
        self._ended = False
        self._finished = False
        self._abandoned = False
        self._sides = sides
        sides.add(self)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Notify the other side."""
        self._transport = cast("asyncio.Transport", transport)
        if self._abandoned:
            self.abandon()
            return
        self._transport.set_write_buffer_limits(high=WINDOW_BYTES // 4)
        for buffer in (socket.SO_RCVBUF, socket.SO_SNDBUF):
            _set_option(self._transport, buffer, KERNEL_BYTES)
        self.carry(ControlSegment.OPEN)

    def data_received(self, data: bytes) -> None:
        """Forward received data."""
        self.carry(data)
        self.throttle()

    def eof_received(self) -> bool:
        """Forward the end of the stream; the other direction continues."""
        self._ended = True
        self.carry(ControlSegment.END)
        return not self._finished

    def connection_lost(self, exc: Exception | None) -> None:
        """Forward a reset, unless both directions have ended."""
        self._sides.discard(self)
        agreed = exc is None and self._ended and self._finished
        if not (agreed or self._abandoned):
            self._abandoned = True
            self.carry(ControlSegment.RESET)

    def resume_writing(self) -> None:
        """Resume reading on the other side."""
        self.other.throttle()

    def throttle(self) -> None:
        """Read only while the window has room."""
        if self._transport is None or self._ended:
            return
        waiting_bytes = self.waiting_bytes + self.other.unwritten_bytes
        if waiting_bytes > WINDOW_BYTES:
            self._transport.pause_reading()
        elif waiting_bytes < WINDOW_BYTES // 2:
            self._transport.resume_reading()

    @property
    def waiting_bytes(self) -> int:
        """Size of data read here and not yet delivered."""
        return self._stream.waiting_bytes

    @property
    def unwritten_bytes(self) -> int:
        """Size of data delivered and not yet accepted by the kernel."""
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    def carry(self, payload: SocketPayload) -> None:
        """Send a payload to the other side."""
        self._channel.resenders.add(self._stream)
        for piece, size_bytes in _pieces(payload):
            self._stream.send(piece, size_bytes + TCP_HEADER_BYTES, self._channel.now_s)
        self._channel.step()

    def abandon(self) -> None:
        """Abort the connection immediately, without notifying the other side."""
        self._abandoned = True
        self._channel.resenders.discard(self._stream)
        if self._transport is None:
            self._sides.discard(self)
        elif not self._transport.is_closing():
            _set_option(self._transport, socket.SO_LINGER, _LINGER_NONE)
            self._transport.abort()

    def write(self, data: bytes) -> None:
        """Write data received by the other side."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def finish(self) -> None:
        """End writing, because the other side has ended."""
        self._finished = True
        if self._transport is not None and not self._transport.is_closing():
            # A connection that was just reset may not be marked as closing yet.
            with contextlib.suppress(OSError):
                self._transport.write_eof()
            if self._ended:
                self._transport.close()

    @abc.abstractmethod
    def opened(self) -> None:
        """Called when the other side is connected."""

    def _hand_over(self, payload: SocketPayload) -> None:
        match payload:
            case ControlSegment.OPEN:
                self.other.opened()
            case ControlSegment.END:
                self.other.finish()
            case ControlSegment.RESET:
                self.other.abandon()
            case bytes():
                self.other.write(payload)
        if payload in (ControlSegment.END, ControlSegment.RESET):
            self._channel.resenders.discard(self._stream)
        self.throttle()


def _set_option(transport: asyncio.Transport, option: int, value: int | bytes) -> None:
    transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, option, value)


def _pieces(payload: SocketPayload) -> Iterator[tuple[SocketPayload, int]]:
    """Split a payload into segments; yield each with its data size in bytes."""
    if isinstance(payload, ControlSegment):
        yield payload, 0
        return
    for start in range(0, len(payload), SEGMENT_BYTES):
        piece = payload[start : start + SEGMENT_BYTES]
        yield piece, len(piece)


class ClientSocket(RelaySocket):
    """Client side of a relayed connection; buffers data until the target is connected.

    The kernel accepts immediately, whereas a handshake over the link would take a round trip.
    """

    def __init__(self, channel: LinkChannel[TcpSegment], sides: set[RelaySocket]) -> None:
        super().__init__(channel, sides)
        self._is_open = False
        self._early: list[SocketPayload] = []

    @property
    def waiting_bytes(self) -> int:
        """Size of data read here and not yet delivered."""
        early_bytes = sum(len(payload) for payload in self._early if isinstance(payload, bytes))
        return early_bytes + super().waiting_bytes

    def carry(self, payload: SocketPayload) -> None:
        """Send a payload to the other side, or buffer it until the target is connected."""
        if self._is_open or payload is ControlSegment.OPEN:
            super().carry(payload)
        elif payload is ControlSegment.RESET:
            self.other.abandon()  # The client has given up, so the target need not connect.
            self._channel.resenders.discard(self._stream)
        else:
            self._early.append(payload)

    def opened(self) -> None:
        """Send the data buffered during the handshake, unless the client has given up."""
        if self._abandoned:
            return
        self._is_open = True
        early, self._early = self._early, []
        for payload in early:
            self.carry(payload)


_LOG = logging.getLogger(__name__)


class TargetSocket(RelaySocket):
    """Target side of a relayed connection; connects when the client's request arrives."""

    def __init__(
        self,
        channel: LinkChannel[TcpSegment],
        sides: set[RelaySocket],
        near: ClientSocket,
        target: Endpoint,
    ) -> None:
        super().__init__(channel, sides)
        self.other = near
        self._target = target
        self._dialling: asyncio.Task[None]

    def opened(self) -> None:
        """Connect, unless the client has given up."""
        if not self._abandoned:
            # Keep a reference, because the loop holds only a weak one.
            self._dialling = asyncio.create_task(self._dial())

    async def _dial(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            await loop.create_connection(lambda: self, self._target.host, self._target.port)
        except (OSError, UnicodeError) as error:
            _LOG.info("no connection to %s: %s", self._target, error)
            self._sides.discard(self)
            if not self._abandoned:
                self.carry(ControlSegment.RESET)


@dataclass(eq=False)
class TcpRelay:
    """Accepts connections at `listen` and opens one to the target for each."""

    listen: Endpoint
    target: Endpoint
    up: LinkChannel[TcpSegment]
    """Clients to target."""
    down: LinkChannel[TcpSegment]
    _sides: set[RelaySocket] = field(init=False, default_factory=set[RelaySocket])

    async def open(self) -> int:
        """Listen, and return the port."""
        listening = bound(self.listen)
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._accept, sock=listening)
        return listening.getsockname()[1]

    async def close(self) -> None:
        """Stop accepting and break all connections."""
        self._server.close()
        for side in tuple(self._sides):
            side.abandon()
        await asyncio.sleep(0)  # Transports close in the next iteration of the loop.
        await self._server.wait_closed()

    def _accept(self) -> ClientSocket:
        near = ClientSocket(self.up, self._sides)
        near.other = TargetSocket(self.down, self._sides, near, self.target)
        return near


HEADER_BYTES = 28
"""IPv4 and UDP headers, which use bandwidth too."""
CAPACITY_BYTES = 256 * 1024
"""Data in flight and queued on a datagram link; excess datagrams are dropped."""
_IDLE_S = 120.0  # Minimum for a NAT (RFC 4787, REQ-5).

Datagram: TypeAlias = Callable[[], object]
"""Sends a datagram onwards when it arrives."""


@dataclass(eq=False)
class UdpRelay:
    """Listens for clients, each with a separate socket to the target, as behind a NAT."""

    listen: Endpoint
    target: Endpoint
    up: LinkChannel[Datagram]
    """Clients to target."""
    down: LinkChannel[Datagram]
    _loop: asyncio.AbstractEventLoop = field(init=False, default_factory=asyncio.get_running_loop)
    _sockets: dict[Address, socket.socket] = field(
        init=False, default_factory=dict[Address, socket.socket]
    )
    """Socket that represents each client towards the target."""
    _used_s: dict[Address, float] = field(init=False, default_factory=dict[Address, float])

    async def open(self) -> int:
        """Listen, and return the port."""
        self._family, self._address = resolved(self.target)
        self._socket = bound(self.listen)
        self._loop.add_reader(self._socket, self._from_clients)
        return self._socket.getsockname()[1]

    async def close(self) -> None:
        """Close all sockets."""
        self._loop.remove_reader(self._socket)
        self._socket.close()
        self._forget(before_s=self._loop.time())

    def _from_clients(self) -> None:
        for data, client in datagrams(self._socket):
            to_target = self._sockets.get(client) or self._map(client)
            self._used_s[client] = self._loop.time()
            self.up.send(partial(to_target.send, data), len(data) + HEADER_BYTES)

    def _from_target(self, to_target: socket.socket, client: Address) -> None:
        for data, _ in datagrams(to_target):
            self._used_s[client] = self._loop.time()
            self.down.send(partial(self._socket.sendto, data, client), len(data) + HEADER_BYTES)

    def _map(self, client: Address) -> socket.socket:
        self._forget(before_s=self._loop.time() - _IDLE_S)
        to_target = socket.socket(self._family, socket.SOCK_DGRAM)
        to_target.setblocking(False)
        to_target.connect(self._address)
        self._loop.add_reader(to_target, self._from_target, to_target, client)
        self._sockets[client] = to_target
        return to_target

    def _forget(self, before_s: float) -> None:
        for client in [each for each, used_s in self._used_s.items() if used_s <= before_s]:
            del self._used_s[client]
            idle = self._sockets.pop(client)
            self._loop.remove_reader(idle)
            idle.close()


def forward(datagram: Datagram) -> None:
    """Send a datagram onwards; if the network does not accept it, it is lost."""
    with contextlib.suppress(OSError):
        datagram()
