"""Parser for MCAP records of untrusted files; limits apply before decompression.

Time and memory are linear in the file size. Reading a chunk uses at most `MOST_CHUNK_BYTES`,
regardless of its header. All errors are reported as one-sentence `RecordingError`s.
"""

from __future__ import annotations

import contextlib
import os
import stat
import struct
import zlib
from collections.abc import Collection, Generator, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from tsd_twin.errors import RecordingError
from tsd_twin.recording.channels import Entry

MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of a complete file."""
MOST_MESSAGE_BYTES = 6 << 20
"""Maximum payload of a message: a 4 MiB bus message in Base64 fits."""
MOST_CHUNK_BYTES = 8 << 20
"""Maximum decompressed size of a chunk; recorders end a chunk after 256 KiB and one message."""
MOST_CHUNK_MESSAGES = 1 << 16
MOST_CHUNKS = 200_000
"""Maximum chunks per file, enough for 22 hours."""
MOST_INDEXED = 4_000_000
"""Maximum index entries, one per chunk and topic in it."""
MOST_CHANNELS = 4096
MOST_TOPIC_BYTES = 1024
_MOST_SCHEMA_BYTES = 1 << 20
_MOST_SUMMARY_BYTES = 256 << 20
_MOST_CHARACTERS = 200
_LATEST_NS = (1 << 63) - 1
"""Wall-clock times of recorders are signed."""
_PACKED_BYTES = MOST_CHUNK_BYTES + (1 << 16)
"""Incompressible data grows slightly."""

_HEADER = struct.Struct("<BQ")
"""Type and length of a record."""
_FOOTER = struct.Struct("<QQI")
_CHUNK = struct.Struct("<QQQI")
"""First and last time, decompressed size and checksum of a chunk."""
_CHUNK_INDEX = struct.Struct("<QQQQI")
_OFFSET = struct.Struct("<HQ")
_GROUP = struct.Struct("<BQQ")
_STATISTICS = struct.Struct("<QHIIIIQQI")
_MESSAGE = struct.Struct("<HIQQ")
"""Header of a message: channel, sequence, log time and publish time."""
_U16, _U32, _U64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")


@contextlib.contextmanager
def readable(path: Path) -> Generator[None]:
    """Convert all errors in the block to a `RecordingError` about a file."""
    try:
        yield
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    except MemoryError as error:
        raise RecordingError(f"{path} cannot be read: it needs too much memory") from error
    except Exception as error:  # Damaged data and decompressors can raise anything.
        text = " ".join(str(error).split())[:_MOST_CHARACTERS] or type(error).__name__
        raise RecordingError(f"{path} is damaged: {text}") from error


class Place(NamedTuple):
    """Location of a chunk in the file."""

    start_ns: int
    end_ns: int
    offset: int
    length: int


class Channels:
    """Channels and schemas of a file, limited in number."""

    def __init__(self) -> None:
        self._channels: dict[int, tuple[str, str, int]] = {}
        self._types: dict[int, str] = {}

    def __contains__(self, number: object) -> bool:
        return number in self._channels

    def of(self, number: int) -> tuple[str, str, str] | None:
        """Return topic, encoding and ROS 2 type of a channel, or None if unknown."""
        if (channel := self._channels.get(number)) is None:
            return None
        return *channel[:2], self._types.get(channel[2], "")

    def wanted(self, topics: Collection[str] | None) -> dict[int, tuple[str, str, str]]:
        """Return the channels of some topics, or all."""
        return {
            number: (topic, encoding, self._types.get(schema, ""))
            for number, (topic, encoding, schema) in self._channels.items()
            if topics is None or topic in topics
        }

    def learn(self, kind: int, body: bytes) -> None:
        """Add a channel or schema record."""
        if kind == Opcode.CHANNEL:
            number, schema = struct.unpack_from("<HH", body)
            topic, at = _text(body, 4, MOST_TOPIC_BYTES)
            encoding, _ = _text(body, at, MOST_TOPIC_BYTES)
            self._channels[number] = topic, encoding, schema
        elif kind == Opcode.SCHEMA:
            if len(body) > _MOST_SCHEMA_BYTES:
                raise ValueError("a schema is too long")
            (number,) = _U16.unpack_from(body)
            self._types[number], _ = _text(body, 2, MOST_TOPIC_BYTES)
        if max(len(self._channels), len(self._types)) > MOST_CHANNELS:
            raise ValueError(f"it has more than {MOST_CHANNELS} topics")


class Summary(NamedTuple):
    """Index at the end of a complete file."""

    channels: Channels
    chunks: list[tuple[Place, list[int]]]
    """Chunks with their channels."""
    start_ns: int
    """Time of the first message, 0 without statistics."""
    end_ns: int
    counts: dict[int, int] | None
    """Message count by channel, or None without statistics."""


class RecordFile:
    """MCAP file opened for reading records."""

    def __init__(self, path: Path) -> None:
        """Open the file.

        Raises:
            RecordingError: If the file is not MCAP or cannot be read.
        """
        self.path = path
        with readable(path):
            if not stat.S_ISREG(path.stat().st_mode):
                raise RecordingError(f"{path} is not a file")  # Opening a pipe would block.
            self._file = path.open("rb")
        try:
            with readable(path):
                if os.pread(self._file.fileno(), len(MAGIC), 0) != MAGIC:
                    raise RecordingError(
                        f"{path} is no recording: it does not begin as an MCAP file"
                    )
                end = self.size - len(MAGIC)
                self.is_whole = end >= len(MAGIC) and self._pread(len(MAGIC), end) == MAGIC
                """Whether the file is complete; otherwise it may be growing."""
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def size(self) -> int:
        """Current size in bytes."""
        return os.fstat(self._file.fileno()).st_size

    def summary(self, *, chunks: bool = True) -> Summary:
        """Read the index; without `chunks` only topics, times and counts, which is faster.

        Raises:
            RecordingError: If the file is damaged or has no index.
        """
        with readable(self.path):
            end = self.size - len(MAGIC) - _HEADER.size - _FOOTER.size
            kind, length = _HEADER.unpack(self._pread(_HEADER.size, max(end, 0)))
            if kind != Opcode.FOOTER or length != _FOOTER.size:
                raise ValueError("its end is damaged")
            start, offsets, _ = _FOOTER.unpack(self._pread(_FOOTER.size, end + _HEADER.size))
            if start == 0:
                raise RecordingError(f"{self.path} has no index")
            parts = [(start, (offsets or end) - start)]
            if not chunks and offsets:
                groups = (
                    _GROUP.unpack_from(body)
                    for kind, body in self._part(offsets, end - offsets, end)
                    if kind == Opcode.SUMMARY_OFFSET
                )
                needed = (Opcode.STATISTICS, Opcode.CHANNEL)
                parts = [(first, size) for kind, first, size in groups if kind in needed]
            return self._summary(parts, end)

    def _summary(self, parts: list[tuple[int, int]], end: int) -> Summary:
        channels, chunks, indexed = Channels(), list[tuple[Place, list[int]]](), 0
        statistics: tuple[int, int, dict[int, int] | None] = 0, 0, None
        for start, length in parts[:2]:
            for kind, body in self._part(start, length, end):
                if kind in (Opcode.CHANNEL, Opcode.SCHEMA):
                    channels.learn(kind, body)
                elif kind == Opcode.STATISTICS:
                    statistics = _statistics(body)
                elif kind == Opcode.CHUNK_INDEX:
                    chunk = _chunk_index(body)
                    indexed += len(chunk[1])
                    if len(chunks) >= MOST_CHUNKS or indexed > MOST_INDEXED:
                        raise ValueError("its index is too long")
                    chunks.append(chunk)
        _check_places([place for place, _ in chunks], end)
        return Summary(channels, chunks, *statistics)

    def walk(self, at: int, size: int) -> Iterator[tuple[int, int, int]]:
        """Yield type, content offset and content length of all complete records from `at`."""
        while at + _HEADER.size <= size:
            kind, length = _HEADER.unpack(self._pread(_HEADER.size, at))
            at += _HEADER.size + length
            if at > size:
                return
            yield kind, at - length, length
            if kind in (Opcode.DATA_END, Opcode.FOOTER):
                return

    def place(self, at: int, length: int) -> Place:
        """Return the chunk whose content starts at an offset."""
        start_ns, end_ns, _, _ = _CHUNK.unpack(self._pread(_CHUNK.size, at))
        return _checked(Place(start_ns, end_ns, at - _HEADER.size, length + _HEADER.size))

    def channel_of_index(self, at: int) -> int:
        """Return the channel of the message index whose content starts at an offset."""
        return _U16.unpack(self._pread(_U16.size, at))[0]

    def entries(
        self, place: Place, channels: Channels, topics: Collection[str] | None = None
    ) -> Iterator[Entry]:
        """Yield the messages of a chunk for some topics, or all, and add its channels.

        Raises:
            RecordingError: If the chunk is damaged or larger than recorders write.
        """
        with readable(self.path):
            if place.length - _HEADER.size > _PACKED_BYTES:
                raise ValueError("a chunk is too large")
            body = self._pread(place.length - _HEADER.size, place.offset + _HEADER.size)
            data = memoryview(_unpacked(body))
            wanted = channels.wanted(topics)
            count = 0
            for kind, content in _records(data):
                if kind == Opcode.MESSAGE:
                    count += 1
                    if count > MOST_CHUNK_MESSAGES:
                        raise ValueError("a chunk has too many messages")
                    number, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(content)
                    if (about := wanted.get(number)) is not None:
                        if len(content) > MOST_MESSAGE_BYTES + _MESSAGE.size:
                            raise ValueError("a message is too long")
                        payload = bytes(content[_MESSAGE.size :])
                        yield Entry(*about, log_ns, publish_ns, sequence, payload)
                elif kind in (Opcode.CHANNEL, Opcode.SCHEMA):
                    channels.learn(kind, bytes(content))
                    wanted = channels.wanted(topics)

    def _part(self, start: int, length: int, end: int) -> Iterator[tuple[int, bytes]]:
        """Yield type and content of the records in a section of the summary."""
        if not len(MAGIC) <= start <= start + length <= end:
            raise ValueError("its index is not where its end says")
        if length > _MOST_SUMMARY_BYTES:
            raise ValueError("its index is too long")
        for kind, content in _records(memoryview(self._pread(length, start))):
            yield kind, bytes(content)

    def _pread(self, length: int, at: int) -> bytes:
        data = os.pread(self._file.fileno(), length, at)
        if len(data) < length:
            raise OSError("it ends too early")
        return data


def is_whole(path: Path) -> bool:
    """Return whether a file ends like a complete MCAP file."""
    with path.open("rb") as file:
        end = os.fstat(file.fileno()).st_size - len(MAGIC)
        return end >= len(MAGIC) and os.pread(file.fileno(), len(MAGIC), end) == MAGIC


def _records(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    at, size = 0, len(data)
    while at < size:
        kind, length = _HEADER.unpack_from(data, at)
        at += _HEADER.size + length
        if at > size:
            raise ValueError("a record is longer than what it is in")
        yield kind, data[at - length : at]


def _unpacked(body: bytes) -> bytes:
    """Decompress a chunk within the size limit."""
    _, _, size, crc = _CHUNK.unpack_from(body)
    compression, at = _text(body, _CHUNK.size, 16)
    (length,) = _U64.unpack_from(body, at)
    packed = memoryview(body)[at + _U64.size :]
    if size > MOST_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes is larger than {MOST_CHUNK_BYTES}")
    if length != len(packed):
        raise ValueError("a chunk is not as long as it says")
    match compression:
        case "":
            data = bytes(packed)
        case "zstd":
            # The decompressor would trust the size in the frame header.
            promised = zstandard.get_frame_parameters(packed).content_size
            if promised not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise ValueError("a chunk does not have the size that it says")
            data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        case "lz4":
            unpacking: Any = lz4.frame.LZ4FrameDecompressor()
            data = unpacking.decompress(packed, max_length=size + 1)
        case _:
            raise ValueError(f"a chunk is compressed by '{compression}'")
    if len(data) != size:
        raise ValueError("a chunk does not have the size that it says")
    if crc and zlib.crc32(data) != crc:
        raise ValueError("the checksum of a chunk is wrong")
    return data


def _text(body: bytes, at: int, most: int) -> tuple[str, int]:
    """Return a length-prefixed text and the offset after it."""
    (length,) = _U32.unpack_from(body, at)
    end = at + _U32.size + length
    if length > most or end > len(body):
        raise ValueError("a name is too long")
    return str(body[at + _U32.size : end], "utf-8"), end


def _chunk_index(body: bytes) -> tuple[Place, list[int]]:
    start_ns, end_ns, offset, length, size = _CHUNK_INDEX.unpack_from(body)
    offsets = body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
    if len(offsets) != size:
        raise ValueError("an entry of the index is cut")
    channels = [number for number, _ in _OFFSET.iter_unpack(offsets)]
    return _checked(Place(start_ns, end_ns, offset, length)), channels


def _checked(place: Place) -> Place:
    if not place.start_ns <= place.end_ns <= _LATEST_NS:
        raise ValueError("the times of a chunk are impossible")
    return place


def _check_places(places: list[Place], end: int) -> None:
    """Reject an index with overlapping chunks, so that no byte of the file is read twice."""
    at = len(MAGIC)
    for place in sorted(places, key=lambda place: place.offset):
        if not at <= place.offset <= place.offset + place.length <= end:
            raise ValueError("its index names one chunk twice, or one outside the file")
        if place.length <= _HEADER.size:
            raise ValueError("its index names an empty chunk")
        at = place.offset + place.length


def _statistics(body: bytes) -> tuple[int, int, dict[int, int]]:
    *_, start_ns, end_ns, size = _STATISTICS.unpack_from(body)
    counts = body[_STATISTICS.size : _STATISTICS.size + size]
    if not start_ns <= end_ns <= _LATEST_NS or len(counts) != size:
        raise ValueError("its statistics are impossible")
    return start_ns, end_ns, dict(_OFFSET.iter_unpack(counts))
