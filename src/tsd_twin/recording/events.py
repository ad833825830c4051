"""Events of a recording that are worth a look: stops, drops, faults, hand-overs, consistency."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

import msgspec

from tsd_twin.messages.services import Event
from tsd_twin.recording.channels import RAW, Entry, robot_of
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.safety import Mode


class EventKind(StrEnum):
    """What an event is about."""

    STOP = "stop"
    DROP = "drop"
    FAULT = "fault"
    HAND_OVER = "hand-over"
    CONSISTENCY = "consistency"
    OTHER = "other"
    """Changes of mode that are no stop, limits that were reached, and all else."""


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """One event of a robot, or several that say the same soon after one another."""

    t_s: float
    """Time since the start of the recording."""
    robot: str
    kind: EventKind
    text: str
    count: int = 1
    """How often it came."""


_KINDS = {
    "drop": EventKind.DROP,
    "lease": EventKind.HAND_OVER,
    "conflict": EventKind.CONSISTENCY,
}
_NEW_MODE = re.compile(r"From \w+ to (\w+)")
_STOPS = frozenset({Mode.STOPPING, Mode.STOPPED})
_MERGED_S = 2.0
"""Events of the same kind and rule that follow within this time count as one."""


def read_events(index: RecordingIndex) -> list[RecordedEvent]:
    """Return all events of a recording in the order of time.

    Raises:
        RecordingError: the file is damaged.
    """
    topics = {topic for topic in index.topics if "/event/" in topic and not topic.endswith(RAW)}
    entries = sorted(index.entries(topics), key=_log_ns)
    return _merged(entries, index.start_ns)


def _merged(entries: Iterable[Entry], start_ns: int) -> list[RecordedEvent]:
    found: list[RecordedEvent] = []
    latest: dict[tuple[str, str, str], tuple[int, float]] = {}
    for entry in entries:
        try:
            event = msgspec.json.decode(entry.data, type=Event)
        except msgspec.DecodeError:
            continue
        t_s, robot = 1e-9 * (entry.log_ns - start_ns), robot_of(entry.topic)
        key = (robot, event.kind, event.rule)
        at, last_s = latest.get(key, (-1, -1.0))
        if at >= 0 and event.kind != "mode" and t_s - last_s < _MERGED_S:
            found[at] = replace(found[at], count=found[at].count + 1)
        else:
            at = len(found)
            found.append(RecordedEvent(t_s, robot, kind_of(event), event.text))
        latest[key] = at, t_s
    return found


def kind_of(event: Event) -> EventKind:
    """Return what an event is about."""
    if event.kind == "mode" and (found := _NEW_MODE.match(event.text)):
        mode = found[1]
        if mode == Mode.FAULT:
            return EventKind.FAULT
        return EventKind.STOP if mode in _STOPS else EventKind.OTHER
    return _KINDS.get(event.kind, EventKind.OTHER)


def _log_ns(entry: Entry) -> int:
    return entry.log_ns
