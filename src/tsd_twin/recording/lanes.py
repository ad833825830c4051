"""Lanes of a recording for its timeline: mode, driver and speed of each robot over time."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from tsd_twin.recording.channels import Entry
from tsd_twin.recording.reader import RecordingReader, decoders, parse_recorded

_SILENT_S = 1.0
"""Age of a status above which the robot counts as silent."""
_NAME_LENGTH = 64


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

    Raises:
        RecordingError: If the file is damaged.
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
