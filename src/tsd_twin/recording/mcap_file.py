"""File of a recording: MCAP, written in chunks that are on the disk within a second, and read whole
or up to where it is cut.
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import IO, Any, cast

from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from tsd_twin.errors import RecordingError
from tsd_twin.messages.ros import definition
from tsd_twin.recording.channels import Entry

PROFILE = "ros2"
LIBRARY = "tsd-twin"
_CHUNK_BYTES = 256 * 1024
_WAITING_BYTES = 32 * 1024 * 1024
"""What waits for a full disk; what comes later is lost."""


class RecordingFile:
    """MCAP file that entries are added to; `flush` puts them on the disk.

    It is always whole up to the last flush, also when the disk is full: what does not fit stays in
    memory and is tried again. The lock shows other recorders that the file is in use.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: it exists, or cannot be created.
        """
        self.path = path
        self.size = 0
        """Bytes on the disk."""
        self.lost = 0
        """Entries that were not recorded since the disk was full for too long."""
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        fcntl.flock(self._fd, fcntl.LOCK_EX)
        self._waiting = _Sink()
        self._writer = McapWriter(cast("IO[Any]", self._waiting))

    @property
    def waiting(self) -> int:
        """Bytes that are not on the disk."""
        return self._waiting.size

    def add(self, entry: Entry) -> None:
        """Add an entry, unless the disk has been full for too long."""
        if self._waiting.size > _WAITING_BYTES:
            self.lost += 1
        else:
            self._writer.add(entry)

    def flush(self) -> None:
        """Put all entries on the disk.

        Raises:
            OSError: the disk is full or broken; nothing is lost, and the next flush tries again.
        """
        self._writer.flush()
        self._write_waiting()

    def close(self) -> None:
        """Write the index, and close the file.

        Raises:
            OSError: it does not fit; the file is as after a power cut.
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
            # A half written chunk would end the file for every reader.
            os.ftruncate(self._fd, self.size)
            os.lseek(self._fd, self.size, os.SEEK_SET)
            raise
        self.size = at
        self._waiting.clear()


class McapWriter:
    """Writer of entries to any stream, with the channels and schemas that they need."""

    def __init__(self, stream: IO[Any]) -> None:
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES)
        self._writer.start(profile=PROFILE, library=LIBRARY)
        self._channels: dict[tuple[str, str, str], int] = {}
        self._schemas: dict[str, int] = {}

    def add(self, entry: Entry) -> None:
        """Add an entry."""
        key = (entry.topic, entry.encoding, entry.type)
        if (channel := self._channels.get(key)) is None:
            schema = self._schema(entry.type) if entry.type else 0
            channel = self._writer.register_channel(entry.topic, entry.encoding, schema)
            self._channels[key] = channel
        self._writer.add_message(
            channel, entry.log_ns, entry.data, entry.publish_ns, entry.sequence
        )

    def flush(self) -> None:
        """End the chunk."""
        self._writer.flush()

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()

    def _schema(self, ros_type: str) -> int:
        if (schema := self._schemas.get(ros_type)) is None:
            text = definition(ros_type).encode()
            schema = self._writer.register_schema(ros_type, "ros2msg", text)
            self._schemas[ros_type] = schema
        return schema


class _Sink:
    """Stream that keeps what is written to it."""

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
        """Do nothing: the owner writes."""

    def clear(self) -> None:
        self.parts, self.size = [], 0


MAGIC = b"\x89MCAP0\r\n"
"""Beginning and end of a whole file."""
_LONGEST_RECORD = 1 << 28
"""A longer one is no record but a damaged length."""


def is_whole(path: Path) -> bool:
    """Return whether a file ends as a whole MCAP file does."""
    with path.open("rb") as file:
        file.seek(0, 2)
        if file.tell() < 2 * len(MAGIC):
            return False
        file.seek(-len(MAGIC), 2)
        return file.read() == MAGIC


def entries(
    path: Path,
    topics: Collection[str] | None = None,
    *,
    from_ns: int | None = None,
    until_ns: int | None = None,
) -> Iterator[Entry]:
    """Yield the entries of a file in the order of their time, up to where it is cut if it is.

    Raises:
        RecordingError: it is no recording.
    """
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{path} is no recording: it does not begin as an MCAP file")
            file.seek(0)
            read = _indexed if is_whole(path) else _streamed
            yield from read(file, topics, from_ns, until_ns)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from error


def topic_list(path: Path) -> list[tuple[str, str, str, int]]:
    """Return topic, encoding, ROS 2 type and number of entries of all topics.

    Raises:
        RecordingError: it is no recording.
    """
    try:
        if path.is_file() and is_whole(path):
            with path.open("rb") as file:
                summary = make_reader(file).get_summary()
            if summary is not None and summary.statistics is not None:
                counts = summary.statistics.channel_message_counts
                return sorted(
                    (
                        channel.topic,
                        channel.message_encoding,
                        _type(summary.schemas.get(channel.schema_id)),
                        counts.get(channel.id, 0),
                    )
                    for channel in summary.channels.values()
                )
    except Exception as error:  # A damaged file raises anything.
        raise RecordingError(f"{path} cannot be read: {error}") from error
    counted: dict[tuple[str, str, str], int] = {}
    for entry in entries(path):
        key = (entry.topic, entry.encoding, entry.type)
        counted[key] = counted.get(key, 0) + 1
    return sorted((*key, count) for key, count in counted.items())


def time_span_ns(path: Path) -> tuple[int, int]:
    """Return the times of the first and the last entry; (0, 0) when there is none."""
    if path.is_file() and is_whole(path):
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        if summary is not None and summary.statistics is not None:
            return summary.statistics.message_start_time, summary.statistics.message_end_time
    times = [entry.log_ns for entry in entries(path)]
    return (min(times), max(times)) if times else (0, 0)


def _indexed(
    file: IO[bytes], topics: Collection[str] | None, from_ns: int | None, until_ns: int | None
) -> Iterator[Entry]:
    found = make_reader(file).iter_messages(
        None if topics is None else list(topics), starting_at=from_ns, ending_before=until_ns
    )
    try:
        for schema, channel, message in found:
            yield _entry(schema, channel, message)
    except Exception as error:  # A damaged file raises anything.
        raise RecordingError(f"{file.name} is damaged: {error}") from error


def _streamed(
    file: IO[bytes], topics: Collection[str] | None, from_ns: int | None, until_ns: int | None
) -> Iterator[Entry]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    wanted = _wanted(topics, from_ns, until_ns)
    records = StreamReader(file, validate_crcs=True, record_size_limit=_LONGEST_RECORD).records
    while True:
        try:
            record: Any = next(records)
        except (
            Exception
        ):  # The end of a cut file; damage raises anything, a decompressor's errors too.
            return
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and (channel := channels.get(record.channel_id)):
            entry = _entry(schemas.get(channel.schema_id), channel, record)
            if wanted(entry):
                yield entry


def _wanted(
    topics: Collection[str] | None, from_ns: int | None, until_ns: int | None
) -> Callable[[Entry], bool]:
    first_ns, end_ns = from_ns or 0, until_ns or 1 << 64

    def wanted(entry: Entry) -> bool:
        return (topics is None or entry.topic in topics) and first_ns <= entry.log_ns < end_ns

    return wanted


def _entry(schema: Schema | None, channel: Channel, message: Message) -> Entry:
    return Entry(
        channel.topic,
        channel.message_encoding,
        _type(schema),
        message.log_time,
        message.publish_time,
        message.sequence,
        message.data,
    )


def _type(schema: Schema | None) -> str:
    return schema.name if schema is not None else ""
