"""One of the two sockets of a relayed TCP connection."""

from __future__ import annotations

import abc
import asyncio
import contextlib
import enum
import socket
import struct
from collections.abc import Iterator
from typing import TypeAlias, cast

from tsd_twin.linksim.lane import Lane
from tsd_twin.linksim.stream import Segment, Stream

SEGMENT_BYTES = 1400
"""Most data in a segment: an Ethernet frame, less headers, options and a tunnel."""
HEADER_BYTES = 40
"""IPv4 and TCP; they take their share of the bandwidth."""
WINDOW_BYTES = 256 * 1024
"""What one direction holds, on the way and waiting, before the relay stops to read."""
KERNEL_BYTES = 64 * 1024
"""What a socket of the relay holds besides; left alone the kernel lets it grow to megabytes."""
_LINGER_NONE = struct.pack("ii", 1, 0)  # Closing sends a reset.


class Mark(enum.Enum):
    """What a segment says that carries no data."""

    OPEN = enum.auto()
    END = enum.auto()
    RESET = enum.auto()


Payload: TypeAlias = bytes | Mark
TcpSegment: TypeAlias = Segment[Payload]


class Side(asyncio.Protocol, abc.ABC):
    """A socket, and the stream that carries what is read from it to the other side."""

    other: Side

    def __init__(self, lane: Lane[TcpSegment], sides: set[Side]) -> None:
        self._lane = lane
        self._stream: Stream[Payload] = Stream(lane.link, self._hand_over)
        self._transport: asyncio.Transport | None = None
        self._ended = False
        self._finished = False
        self._abandoned = False
        self._sides = sides
        sides.add(self)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Tell the other side."""
        self._transport = cast("asyncio.Transport", transport)
        if self._abandoned:
            self.abandon()
            return
        self._transport.set_write_buffer_limits(high=WINDOW_BYTES // 4)
        for buffer in (socket.SO_RCVBUF, socket.SO_SNDBUF):
            _set_option(self._transport, buffer, KERNEL_BYTES)
        self.carry(Mark.OPEN)

    def data_received(self, data: bytes) -> None:
        """Carry what was read."""
        self.carry(data)
        self.throttle()

    def eof_received(self) -> bool:
        """Carry the end; the other direction goes on."""
        self._ended = True
        self.carry(Mark.END)
        return not self._finished

    def connection_lost(self, exc: Exception | None) -> None:
        """Carry a reset, unless this is the end that was agreed on."""
        self._sides.discard(self)
        agreed = exc is None and self._ended and self._finished
        if not (agreed or self._abandoned):
            self._abandoned = True
            self.carry(Mark.RESET)

    def resume_writing(self) -> None:
        """Let the other side read on."""
        self.other.throttle()

    def throttle(self) -> None:
        """Read only while there is room on the way, as a window does."""
        if self._transport is None or self._ended:
            return
        waiting_bytes = self.waiting_bytes + self.other.unwritten_bytes
        if waiting_bytes > WINDOW_BYTES:
            self._transport.pause_reading()
        elif waiting_bytes < WINDOW_BYTES // 2:
            self._transport.resume_reading()

    @property
    def waiting_bytes(self) -> int:
        """Read here and not yet handed over."""
        return self._stream.waiting_bytes

    @property
    def unwritten_bytes(self) -> int:
        """Handed over and not yet taken by the kernel."""
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    def carry(self, payload: Payload) -> None:
        """Send a payload to the other side."""
        self._lane.resenders.add(self._stream)
        for piece, size_bytes in _pieces(payload):
            self._stream.send(piece, size_bytes + HEADER_BYTES, self._lane.now_s)
        self._lane.step()

    def abandon(self) -> None:
        """Break the connection at once, and say nothing to the other side."""
        self._abandoned = True
        self._lane.resenders.discard(self._stream)
        if self._transport is None:
            self._sides.discard(self)
        elif not self._transport.is_closing():
            _set_option(self._transport, socket.SO_LINGER, _LINGER_NONE)
            self._transport.abort()

    def write(self, data: bytes) -> None:
        """Write what the other side read."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def finish(self) -> None:
        """Write no more; the other side has ended."""
        self._finished = True
        if self._transport is not None and not self._transport.is_closing():
            # A connection that was reset a moment ago is not known to be closing yet.
            with contextlib.suppress(OSError):
                self._transport.write_eof()
            if self._ended:
                self._transport.close()

    @abc.abstractmethod
    def opened(self) -> None:
        """Take note that the other side is connected."""

    def _hand_over(self, payload: Payload) -> None:
        match payload:
            case Mark.OPEN:
                self.other.opened()
            case Mark.END:
                self.other.finish()
            case Mark.RESET:
                self.other.abandon()
            case bytes():
                self.other.write(payload)
        if payload in (Mark.END, Mark.RESET):
            self._lane.resenders.discard(self._stream)
        self.throttle()


def _set_option(transport: asyncio.Transport, option: int, value: int | bytes) -> None:
    transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, option, value)


def _pieces(payload: Payload) -> Iterator[tuple[Payload, int]]:
    """Yield segments of a payload, each with the bytes of data in it."""
    if isinstance(payload, Mark):
        yield payload, 0
        return
    for start in range(0, len(payload), SEGMENT_BYTES):
        piece = payload[start : start + SEGMENT_BYTES]
        yield piece, len(piece)
