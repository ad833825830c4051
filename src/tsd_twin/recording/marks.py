"""Marks: notes that people attach to times of a recording, in a file beside it.

A recording is not changed for it: a file that is being written, or that belongs to another user,
cannot take them, and its index would have to be written anew. Each mark is a line of JSON. Its time
is that of the recorder's wall clock, so that it stays right when the recording is completed.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from tsd_twin.errors import RecordingError

_ENDING = ".marks.jsonl"
NOTE_LENGTH = 200
"""Longest note, in characters."""


class Mark(msgspec.Struct, frozen=True):
    """A mark."""

    log_ns: int
    """Wall clock of the recorder at the marked time."""
    note: str
    by: str = ""
    """Operator who made it."""


def marks_file(recording: Path) -> Path:
    """Return the file of the marks of a recording, which need not exist."""
    return recording.with_name(recording.name.removesuffix(".mcap") + _ENDING)


def read_marks(recording: Path) -> list[Mark]:
    """Return the marks of a recording in the order of time; lines that are none are left out.

    Raises:
        RecordingError: they cannot be read.
    """
    found: list[Mark] = []
    try:
        lines = marks_file(recording).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RecordingError(
            f"the marks of {recording} cannot be read: {error.strerror}"
        ) from error
    for line in lines:
        try:
            found.append(msgspec.json.decode(line, type=Mark))
        except (msgspec.DecodeError, UnicodeDecodeError):
            continue  # The last line of a crash.
    return sorted(found, key=lambda mark: mark.log_ns)


def add_mark(recording: Path, mark: Mark) -> None:
    """Add a mark to a recording.

    Raises:
        RecordingError: the note is too long, or cannot be written.
    """
    if len(mark.note) > NOTE_LENGTH:
        raise RecordingError(f"a note has at most {NOTE_LENGTH} characters")
    # On a line of its own, also behind half a line that a crash has left.
    line = b"\n" + msgspec.json.encode(mark) + b"\n"
    try:
        # One write to the end of the file: two pages may mark at the same time.
        fd = os.open(marks_file(recording), os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            os.write(fd, line)
            os.fsync(fd)
        finally:
            os.close(fd)
    except OSError as error:
        raise RecordingError(f"the mark cannot be written: {error.strerror}") from error
