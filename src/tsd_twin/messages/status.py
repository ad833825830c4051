"""Status of a robot as JSON, published 20 times a second, and the stamp on every published
message.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, cast

import msgspec

from tsd_twin.errors import MessageError
from tsd_twin.messages.services import decode_json

_STAMP = struct.Struct("<Qq")
_LEVELS = 8
"""How deep `hardware` may be nested; that of the robots here has three levels."""


class LeaseStatus(msgspec.Struct, frozen=True):
    """Who may drive."""

    holder: str | None = None
    remaining_s: float = 0.0
    asked_by: str | None = None
    """Who asks the holder for control."""
    asks_for_s: float = 0.0
    """How much longer, unless there is an answer."""
    reserved_for: str | None = None
    """Who alone may acquire it, because the holder has granted it."""
    reserved_s: float = 0.0
    """For how much longer."""


class DropCounts(msgspec.Struct):
    """Commands that did not count, each under exactly one reason."""

    stale: int = 0
    lease: int = 0
    order: int = 0
    nonfinite: int = 0
    key: int = 0
    shape: int = 0


class CommandStatus(msgspec.Struct, frozen=True):
    """What became of the commands."""

    seq: int = 0
    """Of the newest counted one."""
    age_s: float | None = None
    """Since the newest counted one; none was counted: null."""
    echo_s: float | None = None
    """How old the status was that the newest counted one answers: the whole way there and back."""
    accepted: int = 0
    dropped: DropCounts = msgspec.field(default_factory=DropCounts)


class LimitStatus(msgspec.Struct, frozen=True):
    """Limits in force, and how much of the request is applied."""

    speed_mps: float = 0.0
    turn_rate_rad_per_s: float = 0.0
    max_command_age_s: float = 0.0
    stop_allowance_m: float = 0.0
    """Travel within which the robot stops at this speed when its link fails, in any way."""
    applied: float = 1.0
    """Share of the requested twist that the limits let through."""


class ConsistencyStatus(msgspec.Struct, frozen=True):
    """How well the measured joints agree with one another."""

    residual_mps: float = 0.0
    suspect: str | None = None
    """The module that the others contradict, once there is evidence."""
    level: float = 0.0
    """Chi-square of the residual over its threshold: from 1 on it is evidence."""
    explained: Mapping[str, float] = {}
    """How much of `level` each module explains alone."""


class WheelSpeedStatus(msgspec.Struct, frozen=True):
    """How fast wheels that always spin shall turn, and do."""

    wanted_rpm: float
    spin_rpm: float
    """As measured, or by the model of the motors; the mean of all wheels."""


class PoseSensorDrops(msgspec.Struct):
    """Poses from outside that were not used, each under exactly one reason."""

    key: int = 0
    shape: int = 0
    frame: int = 0
    nonfinite: int = 0
    quaternion: int = 0
    future: int = 0
    old: int = 0
    flood: int = 0
    far: int = 0


class PoseSensorStatus(msgspec.Struct, frozen=True):
    """What became of the poses that somebody else has seen."""

    hz: float = 0.0
    """Used in the last second."""
    late_s: float | None = None
    """How old the newest was that was used; null when there was none in the last second."""
    used: int = 0
    found: int = 0
    """How often the robot was somewhere else altogether, and was found again."""
    dropped: PoseSensorDrops = msgspec.field(default_factory=PoseSensorDrops)


class LoopStatus(msgspec.Struct, frozen=True):
    """How well the control loop keeps time."""

    hz: float = 0.0
    overruns: int = 0
    jitter_p99_ms: float = 0.0


class ArmingStatus(msgspec.Struct, frozen=True):
    """Where arming stands: `hold` (neutral tilt, zero throttle) or `spin_up`; progress 0 to 1."""

    phase: str
    progress: float


class Status(msgspec.Struct, frozen=True):
    """`state/status`."""

    mode: str
    stop_reason: str = ""
    stops: int = 0
    """How often it has begun to come to rest by itself: none is missed, however short it was."""
    arming: ArmingStatus | None = None
    lease: LeaseStatus = LeaseStatus()
    command: CommandStatus = CommandStatus()
    limits: LimitStatus = LimitStatus()
    consistency: ConsistencyStatus = ConsistencyStatus()
    wheel_speed: WheelSpeedStatus | None = None
    """Of robots whose wheels spin also when they stand."""
    pose_sensor: PoseSensorStatus | None = None
    """Null until somebody has sent a pose."""
    loop: LoopStatus = LoopStatus()
    hardware: Mapping[str, Any] = {}


def encode_status(status: Status) -> bytes:
    """Return the JSON of a status."""
    return msgspec.json.encode(status)


def decode_status(payload: bytes) -> Status:
    """Return the status in a JSON payload; fields that we do not know are ignored.

    Raises:
        MessageError: `shape`, when this is no status.
    """
    status = decode_json(payload, Status, "a status")
    if _is_deeper(status.hardware, _LEVELS):  # What can be read cannot always be written again.
        raise MessageError("shape", f"hardware is nested in more than {_LEVELS} levels")
    return status


def encode_stamp(seq: int, robot_ns: int) -> bytes:
    """Return the attachment of a `state/*` message: its number and the robot's monotonic time."""
    return _STAMP.pack(seq, robot_ns)


def decode_stamp(attachment: bytes) -> tuple[int, int]:
    """Return (seq, robot_ns) of an attachment.

    Raises:
        MessageError: `shape`, when it is none.
    """
    try:
        return _STAMP.unpack(attachment)
    except struct.error as error:
        raise MessageError("shape", f"stamp: {error}") from error


def _is_deeper(value: Any, levels: int) -> bool:
    """Return whether a value of JSON is nested in more than so many levels."""
    if not isinstance(value, dict | list):
        return False
    inside = cast("Any", value)
    parts = inside.values() if isinstance(value, dict) else inside
    return levels <= 0 or any(_is_deeper(part, levels - 1) for part in parts)
