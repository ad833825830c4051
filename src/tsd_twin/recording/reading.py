"""Reading of recordings, whole ones by their index and cut ones up to where they are cut."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import IO, Any

from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from tsd_twin.errors import RecordingError
from tsd_twin.recording.channels import Entry

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
    except Exception as error:  # As below.
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
    except Exception as error:  # As below.
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
