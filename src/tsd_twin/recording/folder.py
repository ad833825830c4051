"""Folder of recordings: names of new files, cut files completed, the oldest ones removed, and a
catalogue with start, duration and robots of each.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import logging
import os
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Footer, Statistics, SummaryOffset
from mcap.stream_reader import MAGIC_SIZE

from tsd_twin.errors import RecordingError, TwinError
from tsd_twin.recording.channels import robot_of
from tsd_twin.recording.events import marks_file, read_marks
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.mcap_file import McapWriter, RecordingFile, entries, is_whole

_PATTERN = "tsd-*.mcap"
"""Only files with such a name are completed or removed: a folder may have others."""
_UNFINISHED = ".part"
_NEW_S = 10.0
_LOG = logging.getLogger(__name__)


LEAST_GB, DEFAULT_GB = 0.01, 5.0
"""Smallest and usual limit of a folder."""


def default_folder(home: Path | None = None) -> Path:
    """Return the folder for recordings of this user, or below another `home` than theirs."""
    data = os.environ.get("XDG_DATA_HOME")
    if home is None and data:
        return Path(data) / "tsd-twin"
    return (home or Path.home()) / ".local/share/tsd-twin"


class RecordingFolder:
    """Folder of recordings with a limit of its size."""

    def __init__(self, path: Path, keep_bytes: int) -> None:
        """Create the folder if needed.

        Raises:
            TwinError: it cannot be created or written to.
        """
        self.path = path
        self.keep_bytes = keep_bytes
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise TwinError(f"{path} cannot be a folder of recordings: {error.strerror}") from error
        if not os.access(path, os.W_OK | os.X_OK):
            raise TwinError(f"{path} cannot be written to: choose another folder")

    def new_file(self) -> RecordingFile:
        """Return a new file, named by the time.

        Raises:
            OSError: it cannot be created.
        """
        stem = datetime.now(UTC).strftime("tsd-%Y%m%dT%H%M%SZ")
        number = 1
        while True:
            suffix = "" if number == 1 else f"-{number}"
            try:
                return RecordingFile(self.path / f"{stem}{suffix}.mcap")
            except FileExistsError:
                number += 1

    def complete_cut_files(self) -> list[Path]:
        """Give an index to files that were cut, as by a power cut; return those.

        Files without any message are removed. A file that does not fit on the disk a second time
        is left as it is, for the next start.
        """
        for left in self.path.glob(_PATTERN + _UNFINISHED):
            left.unlink(missing_ok=True)
        completed: list[Path] = []
        for path in self._unused():
            if is_whole(path):
                continue
            try:
                if _complete(path):
                    completed.append(path)
            except OSError as error:
                _LOG.warning("%s stays cut: %s", path, error.strerror)
        return completed

    def remove_oldest(self) -> list[Path]:
        """Remove the oldest files until the folder keeps its limit; return those."""
        files = sorted(self.path.glob(_PATTERN), key=lambda path: path.stat().st_mtime_ns)
        total = sum(path.stat().st_size for path in files)
        removed: list[Path] = []
        unused = set(self._unused())
        for path in files:
            if total <= self.keep_bytes:
                break
            if path in unused:
                total -= path.stat().st_size
                path.unlink(missing_ok=True)
                marks_file(path).unlink(missing_ok=True)
                removed.append(path)
        return removed

    def _unused(self) -> Iterator[Path]:
        """Yield the files that no recorder writes to, in the order of their names."""
        for path in sorted(self.path.glob(_PATTERN)):
            with contextlib.suppress(OSError), path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                about = path.stat()
                # Another recorder has created it, and will lock it in a moment.
                if about.st_size or time.time() - about.st_mtime > _NEW_S:
                    yield path


def _complete(path: Path) -> bool:
    """Write a cut file anew, with an index; return whether it has any message.

    Raises:
        OSError: it does not fit on the disk.
    """
    unfinished = path.with_name(path.name + _UNFINISHED)
    count = 0
    try:
        with unfinished.open("wb") as file:
            writer = McapWriter(file)
            with contextlib.suppress(RecordingError):  # Not even its beginning is there.
                for entry in entries(path):
                    writer.add(entry)
                    count += 1
            writer.finish()
            file.flush()
            os.fsync(file.fileno())
        if count:
            times = path.stat()
            os.utime(unfinished, ns=(times.st_atime_ns, times.st_mtime_ns))
            unfinished.replace(path)
        else:
            path.unlink()
    finally:
        unfinished.unlink(missing_ok=True)
    return count > 0


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
