"""Index of a recording: which chunks have messages of a topic, so that any time is found at once.

A whole file has this index at its end. One that is being written, or was cut, is walked over
once, from record to record; `refresh` goes on where the last walk ended.
"""

from __future__ import annotations

import bisect
import io
import os
import struct
from collections import OrderedDict
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Schema
from mcap.stream_reader import get_chunk_data_stream

from tsd_twin.errors import RecordingError
from tsd_twin.recording.channels import Entry
from tsd_twin.recording.mcap_file import MAGIC, is_whole

_HEADER = struct.Struct("<BQ")
"""Kind and length of a record."""
_TIMES = struct.Struct("<QQ")
"""First and last time of a chunk, at its beginning."""
_CHANNEL = struct.Struct("<H")
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, and both times, before the payload of a message."""
_CHUNKS_KEPT = 24
"""Decompressed chunks in memory, of at most 256 KiB each: some ten seconds of one robot."""


class _Place(NamedTuple):
    """A chunk in the file."""

    start_ns: int
    end_ns: int
    offset: int
    length: int


class _Chunks:
    """Chunks that have messages of one topic, by their start."""

    def __init__(self) -> None:
        self.places: list[_Place] = []
        self.starts_ns: list[int] = []
        self.ends_ns: list[int] = []
        """Latest end of all chunks up to each: threads may number messages out of order."""

    def add(self, place: _Place) -> None:
        at = bisect.bisect_right(self.starts_ns, place.start_ns)
        self.places.insert(at, place)
        self.starts_ns.insert(at, place.start_ns)
        self.ends_ns.insert(at, 0)
        for i in range(at, len(self.places)):
            before_ns = self.ends_ns[i - 1] if i else 0
            self.ends_ns[i] = max(before_ns, self.places[i].end_ns)


class RecordingIndex:
    """Index of one file, which stays open; messages of a topic are found by time."""

    def __init__(self, path: Path) -> None:
        """Read the index, or walk over a file that has none.

        Raises:
            RecordingError: it is no recording.
        """
        self.path = path
        self.start_ns = self.end_ns = 0
        """Wall clock of the recorder at the first and the last message; 0 without any."""
        self._topics: dict[str, _Chunks] = {}
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._parsed: OrderedDict[int, dict[str, list[Entry]]] = OrderedDict()
        self._walked = len(MAGIC)
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
        try:
            if self._pread(len(MAGIC), 0, short=True) != MAGIC:
                raise RecordingError(f"{path} is no recording: it does not begin as an MCAP file")
            self.is_whole = is_whole(path)
            """Whether the file is closed; otherwise it may be growing."""
            if self.is_whole:
                self._read_summary()
            else:
                self.refresh()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def topics(self) -> Collection[str]:
        """All topics that have messages."""
        return self._topics.keys()

    def newest_first(self, topic: str, at_ns: int) -> Iterator[Entry]:
        """Yield the messages of a topic up to a time, the newest first.

        Of messages with the same time the one that was written last is the newest.

        Raises:
            RecordingError: the file is damaged there.
        """
        chunks = self._topics.get(topic)
        if chunks is None:
            return
        found: list[tuple[int, int, int, Entry]] = []
        for i in range(bisect.bisect_right(chunks.starts_ns, at_ns) - 1, -1, -1):
            place = chunks.places[i]
            messages = enumerate(self._messages(place).get(topic, []))
            found += [(e.log_ns, place.offset, n, e) for n, e in messages if e.log_ns <= at_ns]
            found.sort()  # By time, then by where it was written; no two are in one place.
            before_ns = chunks.ends_ns[i - 1] if i else -1
            while found and found[-1][0] > before_ns:
                yield found.pop()[-1]

    def first_after(self, topic: str, at_ns: int) -> Entry | None:
        """Return the oldest message of a topic after a time; None when there is none.

        Raises:
            RecordingError: the file is damaged there.
        """
        chunks = self._topics.get(topic)
        if chunks is None:
            return None
        found: list[tuple[int, int, int, Entry]] = []
        for i in range(bisect.bisect_right(chunks.ends_ns, at_ns), len(chunks.places)):
            place = chunks.places[i]
            if found and place.start_ns > found[0][0]:
                break
            messages = enumerate(self._messages(place).get(topic, []))
            found += [(e.log_ns, place.offset, n, e) for n, e in messages if e.log_ns > at_ns]
            found.sort()
        return found[0][-1] if found else None

    def entries(self, topics: Collection[str], after_ns: int = -1) -> Iterator[Entry]:
        """Yield the messages of some topics after a time, about in the order of time.

        Raises:
            RecordingError: the file is damaged.
        """
        chunks = [self._topics[topic] for topic in topics if topic in self._topics]
        places = {
            place for each in chunks for place in list(each.places) if place.end_ns > after_ns
        }
        for place in sorted(places):
            for entry in self._read(place, topics):
                if entry.log_ns > after_ns:
                    yield entry

    def refresh(self) -> None:
        """Take in what was written to a growing file since the last call."""
        if self.is_whole:
            return
        try:
            size = os.fstat(self._file.fileno()).st_size
            self._walk(size)
        except (OSError, struct.error) as error:
            raise RecordingError(f"{self.path} cannot be read: {error}") from error

    def _read_summary(self) -> None:
        try:
            summary = make_reader(self._file).get_summary()
        except Exception as error:  # A damaged file raises anything, errors of struct too.
            raise RecordingError(f"{self.path} is damaged: {error}") from error
        if summary is None:
            raise RecordingError(f"{self.path} has no index")
        self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
        for chunk in summary.chunk_indexes:
            place = _Place(
                chunk.message_start_time,
                chunk.message_end_time,
                chunk.chunk_start_offset,
                chunk.chunk_length,
            )
            self._add(place, chunk.message_index_offsets)

    def _add(self, place: _Place, channels: Collection[int]) -> None:
        if not channels:
            return
        for topic in {self._channels[number].topic for number in channels}:
            self._topics.setdefault(topic, _Chunks()).add(place)
        self.start_ns = min(self.start_ns or place.start_ns, place.start_ns)
        self.end_ns = max(self.end_ns, place.end_ns)

    def _walk(self, size: int) -> None:
        """Take in all chunks that are complete, with their message indexes."""
        at, channels = self._walked, set[int]()
        last: _Place | None = None
        while at + _HEADER.size <= size:
            kind, length = _HEADER.unpack(self._pread(_HEADER.size, at))
            following = at + _HEADER.size + length
            if following > size:
                break
            if kind == Opcode.MESSAGE_INDEX and last is not None:
                (channel,) = _CHANNEL.unpack(self._pread(_CHANNEL.size, at + _HEADER.size))
                channels.add(channel)
            elif last is not None:
                self._learn(last, channels)
                last, channels = None, set[int]()
            if kind == Opcode.CHUNK:
                start_ns, end_ns = _TIMES.unpack(self._pread(_TIMES.size, at + _HEADER.size))
                last = _Place(start_ns, end_ns, at, following - at)
            if kind in (Opcode.DATA_END, Opcode.FOOTER):
                break
            at = following
            if last is None:
                self._walked = at
        if last is not None:
            self._learn(last, None)  # The rest of its message indexes may be still to come.
            self._walked = at

    def _learn(self, place: _Place, channels: set[int] | None) -> None:
        """Take in a chunk with messages of these channels, or of those that are found in it."""
        if channels is None or not channels <= self._channels.keys():
            records = list(self._records(place))
            for kind, body in records:
                if kind == Opcode.CHANNEL:
                    channel = Channel.read(ReadDataStream(io.BytesIO(body)))
                    self._channels[channel.id] = channel
                elif kind == Opcode.SCHEMA:
                    schema = Schema.read(ReadDataStream(io.BytesIO(body)))
                    self._schemas[schema.id] = schema
            messages = (body for kind, body in records if kind == Opcode.MESSAGE)
            channels = {_MESSAGE.unpack_from(body)[0] for body in messages}
        self._add(place, channels & self._channels.keys())

    def _messages(self, place: _Place) -> dict[str, list[Entry]]:
        """Return the messages of a chunk by topic, in the order in which they were written."""
        if (known := self._parsed.get(place.offset)) is not None:
            self._parsed.move_to_end(place.offset)
            return known
        parsed: dict[str, list[Entry]] = {}
        for entry in self._read(place, None):
            parsed.setdefault(entry.topic, []).append(entry)
        self._parsed[place.offset] = parsed
        if len(self._parsed) > _CHUNKS_KEPT:
            self._parsed.popitem(last=False)
        return parsed

    def _read(self, place: _Place, topics: Collection[str] | None) -> Iterator[Entry]:
        """Yield the messages of a chunk, of some topics or of all."""
        wanted = {
            number: (channel.topic, channel.message_encoding, self._type(channel))
            for number, channel in list(self._channels.items())  # It may grow meanwhile.
            if topics is None or channel.topic in topics
        }
        for kind, body in self._records(place):
            if kind == Opcode.MESSAGE:
                number, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(body)
                if (about := wanted.get(number)) is not None:
                    yield Entry(*about, log_ns, publish_ns, sequence, body[_MESSAGE.size :])

    def _type(self, channel: Channel) -> str:
        schema = self._schemas.get(channel.schema_id)
        return schema.name if schema is not None else ""

    def _records(self, place: _Place) -> Iterator[tuple[int, bytes]]:
        """Yield kind and content of the records of a chunk.

        Raises:
            RecordingError: it is damaged.
        """
        try:
            packed = self._pread(place.length - _HEADER.size, place.offset + _HEADER.size)
            chunk = Chunk.read(ReadDataStream(io.BytesIO(packed)))
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            data, at = stream.read(size), 0
            while at < size:
                kind, length = _HEADER.unpack_from(data, at)
                at += _HEADER.size + length
                yield kind, data[at - length : at]
        except Exception as error:  # As above, errors of a decompressor too.
            raise RecordingError(f"{self.path} is damaged: {error}") from error

    def _pread(self, length: int, at: int, *, short: bool = False) -> bytes:
        data = os.pread(self._file.fileno(), length, at)
        if len(data) < length and not short:
            raise OSError("it ends too early")
        return data
