"""Events and marks of a recording: stops, drops, faults, handovers, and operators' notes.

Marks are stored in a file next to the recording, because a recording that is being written or
belongs to another user cannot be changed, and changing it would require a new index. Each mark is a
line of JSON. Its time is the recorder's wall clock, so that it stays valid when a truncated
recording is repaired. Reading raises a `RecordingError` if the file is damaged.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from operator import attrgetter
from pathlib import Path

import msgspec

from tsd_twin.errors import RecordingError
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import decode_status
from tsd_twin.recording.channels import RAW, Entry, robot_of
from tsd_twin.recording.index import RecordingIndex


class EventKind(StrEnum):
    """Category of a recorded event."""

    STOP = "stop"
    DROP = "drop"
    FAULT = "fault"
    HAND_OVER = "hand-over"
    CONSISTENCY = "consistency"
    OTHER = "other"
    """Mode changes other than stops, reached limits, and everything else."""


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """Event of a robot, or several similar events in quick succession."""

    t_s: float
    """Time since the start of the recording."""
    robot: str
    kind: EventKind
    text: str
    count: int = 1
    """Number of merged events."""
    why: Reason | None = None
    """Code and parameters behind `text`, unless they are too long."""


_KINDS = {
    "drop": EventKind.DROP,
    "lease": EventKind.HAND_OVER,
    "consistency": EventKind.CONSISTENCY,
}
STOPS = frozenset({Mode.STOPPING, Mode.STOPPED})
"""Modes of a stopped robot."""
_MERGED_S = 2.0
"""Events with the same code within this time are merged."""
_REASON_BYTES = 400


def read_events(index: RecordingIndex) -> list[RecordedEvent]:
    """Return all events of a recording in order of time."""
    found: list[RecordedEvent] = []
    latest: dict[tuple[str, str, str], tuple[int, float]] = {}
    for entry, event in decoded_events(index):
        t_s, robot = 1e-9 * (entry.log_ns - index.start_ns), robot_of(entry.topic)
        key = (robot, event.kind, _same(event))
        at, last_s = latest.get(key, (-1, -1.0))
        if at >= 0 and event.kind != "mode" and t_s - last_s < _MERGED_S:
            found[at] = replace(found[at], count=found[at].count + 1)
        else:
            at = len(found)
            is_old = event.kind == "mode" and event.why is None
            kind = _of_mode(_mode_after(index, robot, entry.log_ns)) if is_old else kind_of(event)
            short = len(msgspec.json.encode(event.why)) <= _REASON_BYTES
            why = event.why if short else None
            found.append(RecordedEvent(t_s, robot, kind, event.text, why=why))
        latest[key] = at, t_s
    return found


def decoded_events(index: RecordingIndex) -> Iterator[tuple[Entry, Event]]:
    """Yield all valid events of a recording with their messages, in order of time."""
    kinds = {topic for topic in index.topics if "/event/" in topic and not topic.endswith(RAW)}
    for entry in sorted(index.ordered(kinds), key=attrgetter("log_ns")):
        try:
            yield entry, msgspec.json.decode(entry.data, type=Event)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue


def modes_of(index: RecordingIndex, robot: str, event: Event, log_ns: int) -> tuple[str, str]:
    """Return the modes before and after a mode change; the first may be empty."""
    if event.why is None:
        return "", _mode_after(index, robot, log_ns)
    return str(event.why.params.get("before", "")), str(event.why.params.get("after", ""))


def kind_of(event: Event) -> EventKind:
    """Return the category of an event."""
    if event.why is not None and event.why.code == Code.MODE_CHANGED:
        return _of_mode(str(event.why.params.get("after", "")))
    return _KINDS.get(event.kind, EventKind.OTHER)


def _of_mode(mode: str) -> EventKind:
    if mode == Mode.FAULT:
        return EventKind.FAULT
    return EventKind.STOP if mode in STOPS else EventKind.OTHER


def _mode_after(index: RecordingIndex, robot: str, at_ns: int) -> str:
    """Return the mode in the status after an event; recordings without codes show it only there."""
    entry = index.first_after(topics.STATUS.key(robot), at_ns - 1)
    try:
        return "" if entry is None else decode_status(entry.data).mode
    except MessageError:
        return ""


def _same(event: Event) -> str:
    """Return the common part of repeated events: their code, request and cause."""
    if event.why is None:
        return event.rule
    cause = [] if event.why.cause is None else [event.why.cause.code]
    return " ".join((event.why.code, *cause, str(event.why.params.get("request", ""))))


_ENDING = ".marks.jsonl"
_MOST_MARKS_BYTES = 1 << 20
"""Maximum bytes read from a file of marks, enough for 4000 marks."""
NOTE_LENGTH = 200
"""Maximum length of a note, characters."""


class Annotation(msgspec.Struct, frozen=True):
    """Operator's note at a time of a recording."""

    log_ns: int
    """Marked time, recorder's wall clock."""
    note: str
    by: str = ""
    """Operator who made the mark."""


def marks_file(recording: Path) -> Path:
    """Return the path of a recording's marks, which may not exist."""
    return recording.with_name(recording.name.removesuffix(".mcap") + _ENDING)


def read_marks(recording: Path) -> list[Annotation]:
    """Return the marks of a recording in order of time; invalid lines are skipped.

    Raises:
        RecordingError: If the marks cannot be read.
    """
    found: list[Annotation] = []
    try:
        with marks_file(recording).open("rb") as file:
            lines = file.read(_MOST_MARKS_BYTES).splitlines()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RecordingError(
            f"the marks of {recording} cannot be read: {error.strerror}"
        ) from error
    for line in lines:
        try:
            found.append(msgspec.json.decode(line, type=Annotation))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue  # Possibly the last line before a crash.
    return sorted(found, key=lambda mark: mark.log_ns)


def add_mark(recording: Path, mark: Annotation) -> None:
    """Add a mark to a recording.

    Raises:
        RecordingError: If the note is too long, the recording does not exist, or the mark cannot be
            written.
    """
    if not recording.is_file():
        raise RecordingError(f"{recording} does not exist")
    if len(mark.note) > NOTE_LENGTH:
        raise RecordingError(f"a note has at most {NOTE_LENGTH} characters")
    # Start a new line, because a crash may have left a partial one.
    line = b"\n" + msgspec.json.encode(mark) + b"\n"
    try:
        # A single append, because two pages may add marks simultaneously.
        fd = os.open(marks_file(recording), os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            os.write(fd, line)
            os.fsync(fd)
        finally:
            os.close(fd)
    except OSError as error:
        raise RecordingError(f"the mark cannot be written: {error.strerror}") from error
