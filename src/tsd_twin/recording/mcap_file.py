"""MCAP files of recordings: written in chunks that reach the disk within a second, read entirely or
up to a truncation.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any, cast

from mcap.opcode import Opcode
from mcap.writer import Writer

from tsd_twin.errors import RecordingError
from tsd_twin.messages.ros_types import definition
from tsd_twin.recording.channels import Entry
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.records import (
    MAGIC,
    MOST_CHANNELS,
    MOST_MESSAGE_BYTES,
    MOST_TOPIC_BYTES,
    Channels,
    RecordFile,
)

PROFILE = "ros2"
LIBRARY = "tsd-twin"
_CHUNK_BYTES = 256 * 1024
_WAITING_BYTES = 32 * 1024 * 1024
"""Maximum data held while the disk is full; later entries are lost."""


class RecordingFile:
    """MCAP file to which entries are added; `flush` writes them to the disk.

    The file is valid up to the last flush, even if the disk is full: unwritten data is kept in
    memory and retried. A lock shows other recorders that the file is in use.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: If it exists or cannot be created.
        """
        self.path = path
        self.size = 0
        """Bytes written to the disk."""
        self.lost = 0
        """Entries lost because the disk was full for too long."""
        self.refused = 0
        """Entries rejected because readers would not accept them: too long, or too many topics."""
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        fcntl.flock(self._fd, fcntl.LOCK_EX)
        self._waiting = _Sink()
        self._writer = McapWriter(cast("IO[Any]", self._waiting))

    @property
    def waiting(self) -> int:
        """Bytes not yet written to the disk."""
        return self._waiting.size

    def add(self, entry: Entry) -> None:
        """Add an entry, unless it is too long or the disk has been full for too long."""
        if not self._writer.fits(entry):
            self.refused += 1
        elif self._waiting.size > _WAITING_BYTES:
            self.lost += 1
        else:
            self._writer.add(entry)

    def flush(self) -> None:
        """Write all entries to the disk.

        Raises:
            OSError: If the disk is full or broken; data is kept, and the next flush retries.
        """
        self._writer.flush()
        self._write_waiting()

    def close(self) -> None:
        """Write the index and close the file.

        Raises:
            OSError: If the index does not fit; the file then looks truncated.
        """
        try:
            self._writer.finish()
            self._write_waiting()
        finally:
            os.close(self._fd)

    def _write_waiting(self) -> None:
        if not self._waiting.parts:
            return
        at = self.size
        try:
            for part in self._waiting.parts:
                view = memoryview(part)
                while view:
                    written = os.write(self._fd, view)
                    if written == 0:
                        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                    view, at = view[written:], at + written
            os.fsync(self._fd)
        except OSError:
            # A partly written chunk would end the file for every reader.
            os.ftruncate(self._fd, self.size)
            os.lseek(self._fd, self.size, os.SEEK_SET)
            raise
        self.size = at
        self._waiting.clear()


class McapWriter(Writer):
    """Writes entries to a stream, with the required channels and schemas."""

    def __init__(self, stream: IO[Any]) -> None:
        super().__init__(stream, chunk_size=_CHUNK_BYTES)
        self.start(PROFILE, LIBRARY)
        self._channels: dict[tuple[str, str, str], int] = {}
        self._schemas: dict[str, int] = {}

    def fits(self, entry: Entry) -> bool:
        """Return whether readers accept an entry within their limits per file."""
        if len(entry.data) > MOST_MESSAGE_BYTES:
            return False
        is_short = len(entry.topic.encode()) <= MOST_TOPIC_BYTES
        return entry[:3] in self._channels or (is_short and len(self._channels) < MOST_CHANNELS)

    def add(self, entry: Entry) -> None:
        """Add an entry."""
        key = entry[:3]
        if (channel := self._channels.get(key)) is None:
            schema = self._schema(entry.type) if entry.type else 0
            channel = self.register_channel(entry.topic, entry.encoding, schema)
            self._channels[key] = channel
        self.add_message(channel, entry.log_ns, entry.data, entry.publish_ns, entry.sequence)

    def _schema(self, ros_type: str) -> int:
        if (schema := self._schemas.get(ros_type)) is None:
            text = definition(ros_type).encode()
            schema = self.register_schema(ros_type, "ros2msg", text)
            self._schemas[ros_type] = schema
        return schema


class _Sink:
    """Stream that keeps the written data."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self._end = 0

    def write(self, data: bytes) -> int:
        if data:
            self.parts.append(bytes(data))
            self.size += len(data)
            self._end += len(data)
        return len(data)

    def tell(self) -> int:
        return self._end

    def flush(self) -> None:
        """Do nothing, because the owner writes the data."""

    def clear(self) -> None:
        self.parts, self.size = [], 0


def entries(
    path: Path,
    topics: Collection[str] | None = None,
    *,
    from_ns: int | None = None,
    until_ns: int | None = None,
) -> Iterator[Entry]:
    """Yield the entries of a file in order of time; truncated files in order of writing.

    Raises:
        RecordingError: If the file is not a recording, or is damaged.
    """
    first_ns, end_ns = from_ns or 0, until_ns or 1 << 64
    with contextlib.closing(RecordFile(path)) as file:
        if not file.is_whole:
            for entry in _until_damaged(file, topics):
                if first_ns <= entry.log_ns < end_ns:
                    yield entry
            return
    with contextlib.closing(RecordingIndex(path)) as index:
        yield from index.ordered(topics, first_ns, end_ns)


def _until_damaged(file: RecordFile, topics: Collection[str] | None) -> Iterator[Entry]:
    """Yield the entries of a truncated file up to its end or the first damaged record."""
    channels = Channels()
    try:
        for kind, at, length in file.walk(len(MAGIC), file.size):
            if kind == Opcode.CHUNK:
                yield from file.entries(file.place(at, length), channels, topics)
    except (RecordingError, OSError, ValueError):
        return


def summary(path: Path) -> tuple[list[tuple[str, str, str, int]], int, int]:
    """Return topic, encoding, ROS 2 type and message count of all topics, and first and last time.

    Both times are 0 if the file is empty.

    Raises:
        RecordingError: If the file is not a recording.
    """
    with contextlib.closing(RecordFile(path)) as file:
        if file.is_whole:
            channels, _, start_ns, end_ns, counts = file.summary()
            if counts is not None:
                topics = [(*about, counts.get(n, 0)) for n, about in channels.wanted(None).items()]
                return sorted(topics), start_ns, end_ns
    counted: Counter[tuple[str, str, str]] = Counter()
    first_ns, last_ns = 1 << 64, 0
    for entry in entries(path):
        counted[entry[:3]] += 1
        first_ns, last_ns = min(first_ns, entry.log_ns), max(last_ns, entry.log_ns)
    topics = [(*about, count) for about, count in counted.items()]
    return sorted(topics), min(first_ns, last_ns), last_ns
