"""CDR, the encoding of ROS 2 messages: the parts of it that the messages of the bus consist of."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.messages.errors import MessageError

LARGEST = 4096  # Bytes; messages of this project have fewer than 800.
_HEAD = b"\x00\x01\x00\x00"
"""Encapsulation header of little-endian CDR; alignment is counted from its end."""
_SURPLUS = 3
"""Most bytes behind a message: some writers pad it to a multiple of four."""

Stamp: TypeAlias = tuple[int, str]
"""Time in nanoseconds, and frame, as in `std_msgs/msg/Header`."""


class CdrWriter:
    """Writes a message as little-endian CDR, field by field."""

    def __init__(self) -> None:
        self._body = bytearray()

    def header(self, stamp_ns: int, frame: str) -> None:
        """Append a `std_msgs/msg/Header`."""
        self._pack("iI", *divmod(stamp_ns, 1_000_000_000))
        self.text(frame)

    def text(self, text: str) -> None:
        """Append a string."""
        raw = text.encode()
        self._pack("I", len(raw) + 1)
        self._body += raw + b"\0"

    def texts(self, texts: Sequence[str]) -> None:
        """Append a sequence of strings."""
        self._pack("I", len(texts))
        for text in texts:
            self.text(text)

    def doubles(self, values: Iterable[float]) -> None:
        """Append float64 fields, or a fixed-size array of them."""
        numbers = np.asarray(values, dtype="<f8").tobytes()
        self._align(8)
        self._body += numbers

    def double_sequence(self, values: Array) -> None:
        """Append a sequence of float64; an empty one has no padding for its elements."""
        self._pack("I", len(values))
        if len(values):
            self.doubles(values)

    def unsigned(self, *values: int) -> None:
        """Append uint32 fields."""
        self._pack(f"{len(values)}I", *values)

    def boolean(self, value: bool) -> None:
        """Append a boolean."""
        self._body.append(value)

    def raw(self, data: bytes) -> None:
        """Append a sequence of bytes."""
        self._pack("I", len(data))
        self._body += data

    def payload(self) -> bytes:
        """Return the encoded message."""
        return _HEAD + self._body

    def _pack(self, fields: str, *values: int) -> None:
        self._align(4)
        self._body += struct.pack(f"<{fields}", *values)

    def _align(self, size: int) -> None:
        self._body += bytes(-len(self._body) % size)


class CdrReader:
    """Reads a message from CDR in either byte order, field by field.

    Raises:
        MessageError: If the payload is too large or has no CDR header (`shape`). Every method
            raises it if the payload is too short or a string is invalid.
    """

    def __init__(self, payload: bytes, type_name: str, largest: int = LARGEST) -> None:
        self._type = type_name
        if len(payload) > largest:
            raise MessageError("shape", f"{len(payload)} bytes are too many for a {type_name}")
        if len(payload) < len(_HEAD) or payload[0] != 0 or payload[1] not in (0, 1):
            raise self._error("no CDR header")
        self._order = "<" if payload[1] else ">"
        self._body = payload[len(_HEAD) :]
        self._at = 0

    def header(self) -> Stamp:
        """Read a `std_msgs/msg/Header`."""
        sec, nanosec = struct.unpack(f"{self._order}iI", self._take(8, 4))
        return sec * 1_000_000_000 + nanosec, self.text()

    def text(self) -> str:
        """Read a string."""
        raw = self._take(self._count(), 1)
        if not raw.endswith(b"\0"):
            raise self._error("a string without its end")
        try:
            return raw[:-1].decode()
        except UnicodeDecodeError as error:
            raise self._error(str(error)) from error

    def texts(self) -> tuple[str, ...]:
        """Read a sequence of strings."""
        # An impossible count fails at the first string that is missing.
        return tuple(self.text() for _ in range(self._count()))

    def doubles(self, count: int) -> Array:
        """Read `count` float64 fields, or a fixed-size array of them, to a new array (count,)."""
        return np.frombuffer(self._take(8 * count, 8), f"{self._order}f8").astype(np.float64)

    def double_sequence(self) -> Array:
        """Read a sequence of float64 to a new array."""
        count = self._count()
        return self.doubles(count) if count else np.empty(0)

    def unsigned(self, count: int) -> tuple[int, ...]:
        """Read `count` uint32 fields."""
        return struct.unpack(f"{self._order}{count}I", self._take(4 * count, 4))

    def raw(self) -> bytes:
        """Read a sequence of bytes."""
        return self._take(self._count(), 1)

    def end(self) -> None:
        """Check that the message ends here.

        Raises:
            MessageError: If more than padding follows (`shape`).
        """
        if len(self._body) - self._at > _SURPLUS:
            raise self._error("more bytes than it has")

    def _count(self) -> int:
        return struct.unpack(f"{self._order}I", self._take(4, 4))[0]

    def _take(self, size: int, alignment: int) -> bytes:
        start = self._at + -self._at % alignment
        if start + size > len(self._body):
            raise self._error("it ends too early")
        self._at = start + size
        return self._body[start : self._at]

    def _error(self, problem: str) -> MessageError:
        return MessageError("shape", f"not a {self._type}: {problem}")
