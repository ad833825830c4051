"""Details of a recording: drivers, stops, faults and paths for lists; lanes for its timeline.

Reading raises a `RecordingError` if the file is damaged.
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

import msgspec

from tsd_twin.errors import RecordingError
from tsd_twin.messages import topics
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import decode_status
from tsd_twin.recording.channels import Entry, robot_of, robots_in
from tsd_twin.recording.events import STOPS, decoded_events, modes_of
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.reader import MOST_ROBOTS, RecordingReader, decoders, parse_recorded
from tsd_twin.recording.records import readable

_MOST_DRIVERS = 20
_NAME_LENGTH = 64
_MOST_FAULT_TEXTS = 10
_TEXT_LENGTH = 200
_SILENT_S = 1.0
"""Age of a status above which the robot counts as silent."""


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
    """Read the details of an open recording, with `points` positions of each robot."""
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
    tracks: dict[str, list[tuple[float, float]]] = {}
    with contextlib.suppress(RecordingError):  # Damaged in the middle: the events have been read.
        tracks = reader.track(points)
    return RecordingDetails(tuple(drivers), stops, faults, tuple(texts), tracks)


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


class RobotLanes(msgspec.Struct, frozen=True):
    """Values at evenly spaced times from start to end; None while the robot was silent."""

    modes: list[str | None]
    drivers: list[str | None]
    """Display name of the lease holder, or its id without one; None also without a holder."""
    speeds: list[float | None]
    """Estimated speed in m/s, or rad/s for a sphere."""


def read_lanes(reader: RecordingReader, count: int) -> tuple[float, dict[str, RobotLanes]]:
    """Read the lanes of each robot that can be shown, with `count` samples up to the end.

    The end is in seconds since the start.
    """
    contents = reader.contents()
    span_ns = contents.end_ns - contents.start_ns
    found: dict[str, RobotLanes] = {}
    for robot_id, text in contents.robots.items():
        decode = decoders(parse_recorded(text, robot_id))
        lanes = found[robot_id] = RobotLanes([], [], [])
        for i in range(count):
            at_ns = contents.start_ns + span_ns * i // (count - 1)
            states = reader.states([robot_id], at_ns)[robot_id].found
            status, odom = (_current(states.get(name), at_ns) for name in ("status", "odom"))
            lanes.modes.append(None)
            lanes.drivers.append(None)
            lanes.speeds.append(None)
            if status is not None:
                lanes.modes[-1], lanes.drivers[-1] = _status_of(decode["status"](status.data))
            if status is not None and odom is not None:
                lanes.speeds[-1] = _speed_of(decode["odom"](odom.data))
    return 1e-9 * span_ns, found


def _current(entry: Entry | None, at_ns: int) -> Entry | None:
    return None if entry is None or at_ns - entry.log_ns > 1e9 * _SILENT_S else entry


def _status_of(status: Any) -> tuple[str, str | None]:
    holder = status.lease.holder
    name = None if holder is None else status.operators.get(holder) or holder
    return status.mode[:_NAME_LENGTH], None if name is None else name[:_NAME_LENGTH]


def _speed_of(odometry: Any) -> float | None:
    vx, vy, last = (float(part) for part in odometry.twist)
    speed = math.hypot(vx, vy) if odometry.wxyz is None else math.hypot(vx, vy, last)
    return round(speed, 3) if math.isfinite(speed) else None
