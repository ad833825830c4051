"""Status of a robot as JSON, published 20 times a second, and the stamp on every published
message.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, cast

import msgspec

from tsd_twin.errors import MessageError
from tsd_twin.messages.codes import Code, Reason, because, text_reason
from tsd_twin.messages.requests import decode_json
from tsd_twin.messages.sentences import sentence

RECORDING = "recording"
"""`hardware.kind` in the status of a replayed recording."""
_STAMP = struct.Struct("<Qq")
_LEVELS = 8
"""Largest nesting depth of `hardware`; the shipped robots use three levels."""


class LeaseStatus(msgspec.Struct, frozen=True):
    """Lease in force, with the pending request and the reservation."""

    holder: str | None = None
    remaining_s: float = 0.0
    asked_by: str | None = None
    """Operator who requests control from the holder."""
    asks_for_s: float = 0.0
    """Remaining time of the request."""
    reserved_for: str | None = None
    """Operator for whom the next lease is reserved, after a grant."""
    reserved_s: float = 0.0
    """Remaining time of the reservation."""


class Refusals(msgspec.Struct, frozen=True):
    """Which requests the robot would refuse now, each with the reason that it answers with.

    Null is accepted. The reasons are those for the holder of the lease; without a lease, for all
    operators.
    """

    lease: str | None = None
    """Of acquiring the lease without a take-over, for operators without a reservation."""
    without_lease: str = ""
    """Of each request below, for an operator who does not hold the lease; never accepted."""
    arm: str | None = None
    disarm: str | None = None
    reset: str | None = None
    drive: str | None = None
    """Why a fresh non-zero command would not move the robot; a command gets no answer."""
    set_pose: str | None = None
    speed: str | None = None
    """Of choosing the speed of wheels that always spin."""
    why: Mapping[str, Reason] = {}
    """Code and parameters of each refusal above, by its field."""

    @staticmethod
    def of(why: Mapping[str, Reason | None]) -> Refusals:
        """Refusals with their reasons, None for what is accepted."""
        reasons = {field: reason for field, reason in why.items() if reason is not None}
        return Refusals(
            **{field: sentence(reason) for field, reason in reasons.items()}, why=reasons
        )


class DropCounts(msgspec.Struct):
    """Counts of dropped commands, each under exactly one reason."""

    stale: int = 0
    lease: int = 0
    order: int = 0
    nonfinite: int = 0
    key: int = 0
    shape: int = 0


class CommandStatus(msgspec.Struct, frozen=True):
    """Newest counted command, and counts of dropped ones."""

    seq: int = 0
    """Sequence number of the newest counted command."""
    age_s: float | None = None
    """Time since the newest counted command; null without one."""
    echo_s: float | None = None
    """Age of the status that the newest counted command echoes: the round trip."""
    accepted: int = 0
    dropped: DropCounts = msgspec.field(default_factory=DropCounts)


class LimitStatus(msgspec.Struct, frozen=True):
    """Limits in force, and the applied share of the request."""

    speed_mps: float = 0.0
    turn_rate_rad_per_s: float = 0.0
    max_command_age_s: float = 0.0
    stop_allowance_m: float = 0.0
    """Travel within which the robot stops from this speed after any link failure."""
    applied: float = 1.0
    """Share of the requested twist that is applied within the limits."""
    reason: str = ""
    """Reason why the limits are lower than usual; else empty."""
    why: tuple[Reason, ...] = ()
    """Codes and parameters behind `reason`."""


class ConsistencyStatus(msgspec.Struct, frozen=True):
    """Consistency of the measured joints: residual of the forward kinematics, and suspect."""

    residual_mps: float = 0.0
    suspect: str | None = None
    """The suspected module, null while the residual is below the threshold."""
    level: float = 0.0
    """Chi-square of the residual over its threshold; at 1 and above it is significant."""
    explained: Mapping[str, float] = {}
    """Share of `level` due to each module alone."""


class WheelSpeedStatus(msgspec.Struct, frozen=True):
    """Speed of wheels that always spin: requested and actual."""

    wanted_rpm: float
    spin_rpm: float
    """Mean speed of all wheels, as measured or from the motor model."""


class PoseSensorDrops(msgspec.Struct):
    """Counts of dropped pose measurements, each under exactly one reason."""

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
    """Statistics of the pose measurements: used, dropped, delay and relocalizations."""

    hz: float = 0.0
    """Number of measurements used in the last second."""
    late_s: float | None = None
    """Delay of the newest used measurement; null without one in the last second."""
    used: int = 0
    found: int = 0
    """Number of relocalizations."""
    dropped: PoseSensorDrops = msgspec.field(default_factory=PoseSensorDrops)


class LearnedError(msgspec.Struct, frozen=True):
    """Constant error of the robot that it has learned, in the unit of its name."""

    value: float
    sigma: float


class LoopStatus(msgspec.Struct, frozen=True):
    """Timing of the control loop: rate, overruns, jitter and the longest period."""

    hz: float = 0.0
    overruns: int = 0
    jitter_p99_ms: float = 0.0
    longest_ms: float = 0.0


class ArmingStatus(msgspec.Struct, frozen=True):
    """Progress of arming, 0 to 1, in `hold` (neutral tilt, zero throttle) or `spin_up`."""

    phase: str
    progress: float


class Status(msgspec.Struct, frozen=True):
    """`state/status`."""

    mode: str
    stop_reason: str = ""
    stops: int = 0
    """Number of controlled stops started by the robot; the count reveals also the shortest."""
    stop: Reason | None = None
    """Code and parameters behind `stop_reason`."""
    arming: ArmingStatus | None = None
    lease: LeaseStatus = LeaseStatus()
    refusals: Refusals | None = None
    """Null from robots that do not send it."""
    command: CommandStatus = CommandStatus()
    limits: LimitStatus = LimitStatus()
    consistency: ConsistencyStatus = ConsistencyStatus()
    wheel_speed: WheelSpeedStatus | None = None
    """Present for robots whose wheels spin also at standstill."""
    pose_sensor: PoseSensorStatus | None = None
    """Null until a first pose measurement has arrived."""
    learned: Mapping[str, LearnedError] | None = None
    """Constant errors by name; null without a measurement that shows any."""
    loop: LoopStatus = LoopStatus()
    hardware: Mapping[str, Any] = {}

    @property
    def is_recording(self) -> bool:
        """Whether a replay sends this status; a recording cannot be driven or stopped."""
        return self.hardware.get("kind") == RECORDING

    @property
    def no_drive_reason(self) -> str:
        """The robot's reason why it does not move; its mode when it gives none."""
        return sentence(self.why_no_drive)

    @property
    def why_no_drive(self) -> Reason:
        """Reason why the robot does not move; its mode when it gives none."""
        refusals = self.refusals or Refusals()
        why = refusals.why.get("drive") or text_reason(refusals.drive or "")
        return why or because(Code.MODE_ONLY, mode=self.mode)


def encode_status(status: Status) -> bytes:
    """JSON of a status."""
    return msgspec.json.encode(status)


def decode_status(payload: bytes) -> Status:
    """Status in a JSON payload; unknown fields are ignored.

    Raises:
        MessageError: `shape`, when this is no status.
    """
    status = decode_json(payload, Status, "a status")
    if _is_deeper(status.hardware, _LEVELS):  # Deep nesting decodes, but may not encode.
        raise MessageError("shape", f"hardware is nested in more than {_LEVELS} levels")
    return _with_reasons(status)


def _with_reasons(status: Status) -> Status:
    """Return a status in which each text has a reason; robots without codes send texts only."""
    refusals, limits = status.refusals, status.limits
    if refusals is not None and not refusals.why and refusals.without_lease:
        texts = {field: getattr(refusals, field) for field in _REFUSED}
        why = {field: reason for field, text in texts.items() if (reason := text_reason(text))}
        refusals = msgspec.structs.replace(refusals, why=why)
    if limits.reason and not limits.why:
        limits = msgspec.structs.replace(limits, why=(Reason(Code.TEXT, {"text": limits.reason}),))
    stop = status.stop or text_reason(status.stop_reason)
    if refusals is status.refusals and limits is status.limits and stop is status.stop:
        return status
    return msgspec.structs.replace(status, refusals=refusals, limits=limits, stop=stop)


_REFUSED = tuple(field for field in Refusals.__struct_fields__ if field != "why")


def encode_stamp(seq: int, robot_ns: int) -> bytes:
    """Attachment of a `state/*` message: its number and the robot's monotonic time."""
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
