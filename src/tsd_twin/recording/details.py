"""Details of a recording for lists: who drove, stops, faults, and the paths of its robots."""

from __future__ import annotations

import msgspec

from tsd_twin.errors import RecordingError
from tsd_twin.messages import topics
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import decode_status
from tsd_twin.recording.channels import robot_of, robots_in
from tsd_twin.recording.events import STOPS, decoded_events, modes_of
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.reader import MOST_ROBOTS, RecordingReader
from tsd_twin.recording.records import readable

_MOST_DRIVERS = 20
_NAME_LENGTH = 64
_MOST_FAULT_TEXTS = 10
_TEXT_LENGTH = 200


class RecordingDetails(msgspec.Struct, frozen=True):
    """Details that require reading the events and states of a recording."""

    drivers: tuple[str, ...]
    """Operators who had control, in order of time."""
    stops: int
    faults: int
    fault_texts: tuple[str, ...]
    """Different faults, as recorded."""
    tracks: dict[str, list[tuple[float, float]]]
    """Floor positions of each robot at evenly spaced times, m; see `RecordingReader.track`."""


def read_details(reader: RecordingReader, points: int) -> RecordingDetails:
    """Read the details of an open recording, with `points` positions of each robot.

    Raises:
        RecordingError: If the file is damaged.
    """
    index = reader.index
    stops = faults = 0
    texts: dict[str, None] = {}
    drivers: dict[str, None] = {}
    latest: dict[str, str] = {}
    with readable(index.path):
        for robot in robots_in(index.topics)[:MOST_ROBOTS]:
            _add_holders(drivers, index, robot, index.start_ns)
        for entry, event in decoded_events(index):
            robot = robot_of(entry.topic)
            if event.kind == "lease":
                _add_holders(drivers, index, robot, entry.log_ns)
            if event.kind != "mode":
                continue
            before, mode = modes_of(index, robot, event, entry.log_ns)
            before = before or latest.get(robot, "")
            latest[robot] = mode
            stops += mode in STOPS and before not in STOPS
            if mode == Mode.FAULT and before != Mode.FAULT:
                faults += 1
                if len(texts) < _MOST_FAULT_TEXTS:
                    texts[event.text[:_TEXT_LENGTH]] = None
        for robot in robots_in(index.topics)[:MOST_ROBOTS]:
            _add_holders(drivers, index, robot, index.end_ns + 1)
    return RecordingDetails(tuple(drivers), stops, faults, tuple(texts), _tracks(reader, points))


def _add_holders(drivers: dict[str, None], index: RecordingIndex, robot: str, at_ns: int) -> None:
    """Add the lease holders in the last status before a time and in the first one from it.

    Both count, because events are lost while the link of the recorder is interrupted.
    """
    key = topics.STATUS.key(robot)
    before = next(index.newest_first(key, at_ns - 1), None)
    for entry in (before, index.first_after(key, at_ns - 1)):
        if entry is None or len(drivers) >= _MOST_DRIVERS:
            continue
        try:
            holder = decode_status(entry.data).lease.holder
        except MessageError:
            continue
        if holder:
            drivers[holder[:_NAME_LENGTH]] = None


def _tracks(reader: RecordingReader, points: int) -> dict[str, list[tuple[float, float]]]:
    try:
        return reader.track(points)
    except RecordingError:  # Damaged in the middle: the events have been read.
        return {}
