"""Catalogue of the recordings in a folder: start, duration and robots of each."""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Footer, Statistics, SummaryOffset
from mcap.stream_reader import MAGIC_SIZE

from tsd_twin.errors import RecordingError
from tsd_twin.recording.channels import robot_of
from tsd_twin.recording.events import read_marks
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.reading import is_whole

_HEADER = struct.Struct("<BQ")
"""Kind and length of a record."""
_FOOTER_BYTES = FOOTER_SIZE + MAGIC_SIZE


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """A recording in a list."""

    path: Path
    start_ns: int
    """Wall clock of the recorder at the start; 0 without any message."""
    duration_s: float
    robots: tuple[str, ...]
    size: int
    """Bytes."""
    is_whole: bool
    """Whether it is closed; otherwise it is being written, or was cut."""
    marks: int = 0
    """Number of marks."""


class Catalogue:
    """Catalogue of one folder; a file is read again only when it has changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._known: dict[Path, tuple[tuple[int, int], RecordingSummary]] = {}
        self._growing: dict[Path, RecordingIndex] = {}

    def recordings(self) -> list[RecordingSummary]:
        """Return all recordings, the newest first; files that cannot be read are left out."""
        found: dict[Path, tuple[tuple[int, int], RecordingSummary]] = {}
        for path in self.folder.glob("*.mcap"):
            try:
                about = path.stat()
                stamp = about.st_mtime_ns, about.st_size
                known = self._known.get(path)
                summary = known[1] if known and known[0] == stamp else self._summary(path)
                found[path] = stamp, replace(summary, marks=len(read_marks(path)))
            except (RecordingError, OSError):
                continue  # No recording, or one that was removed meanwhile.
        self._known = found
        for path in self._growing.keys() - found.keys():
            self._growing.pop(path).close()
        every = [summary for _, summary in found.values()]
        return sorted(every, key=lambda each: (each.start_ns, each.path.name), reverse=True)

    def close(self) -> None:
        """Close the files that are being written."""
        for index in self._growing.values():
            index.close()
        self._growing.clear()

    def _summary(self, path: Path) -> RecordingSummary:
        whole = is_whole(path)
        if whole:
            start_ns, end_ns, topics = _statistics(path)
            if path in self._growing:
                self._growing.pop(path).close()
        else:
            index = self._growing.get(path)
            if index is None:
                index = self._growing[path] = RecordingIndex(path)
            index.refresh()
            start_ns, end_ns, topics = index.start_ns, index.end_ns, set(index.topics)
        return RecordingSummary(
            path,
            start_ns,
            1e-9 * (end_ns - start_ns),
            tuple(sorted({robot_of(topic) for topic in topics} - {"", "*"})),
            path.stat().st_size,
            whole,
        )


def _statistics(path: Path) -> tuple[int, int, set[str]]:
    """Return start, end and topics of a whole file.

    Only these parts of its summary are read: the index of an hour has ten thousand chunks.

    Raises:
        RecordingError: the file is damaged.
    """
    try:
        with path.open("rb") as file:
            end = file.seek(-_FOOTER_BYTES, os.SEEK_END)
            ((_, body),) = _records(file, end, FOOTER_SIZE)
            footer = Footer.read(_stream(body))
            offsets = _records(file, footer.summary_offset_start, end - footer.summary_offset_start)
            groups = {
                each.group_opcode: (each.group_start, each.group_length)
                for each in (SummaryOffset.read(_stream(body)) for _, body in offsets)
            }
            ((_, body),) = _records(file, *groups[Opcode.STATISTICS])
            statistics = Statistics.read(_stream(body))
            channels = _records(file, *groups.get(Opcode.CHANNEL, (0, 0)))
            topics = {Channel.read(_stream(body)).topic for _, body in channels}
    except Exception as error:  # A damaged file raises anything, errors of struct too.
        raise RecordingError(f"{path} is damaged: {error}") from error
    return statistics.message_start_time, statistics.message_end_time, topics


def _records(file: IO[bytes], start: int, length: int) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records in a part of a file."""
    file.seek(start)
    data, at = file.read(length), 0
    while at < length:
        kind, size = _HEADER.unpack_from(data, at)
        at += _HEADER.size + size
        yield kind, data[at - size : at]


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))
