"""Robot status as JSON, published at 20 Hz, and the stamp attached to each message."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, cast

import msgspec

from tsd_twin.messages.codes import Code, Reason, because, text_reason
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import decode_json

RECORDING = "recording"
"""`hardware.kind` in the status of a replayed recording."""
_STAMP = struct.Struct("<Qq")
_LEVELS = 8
"""Maximum nesting depth of `hardware`; shipped robots use three levels."""


class LeaseStatus(msgspec.Struct, frozen=True):
    """Active lease, pending request and reservation."""

    holder: str | None = None
    remaining_s: float = 0.0
    requested_by: str | None = None
    """Operator requesting control."""
    request_expires_in_s: float = 0.0
    """Remaining time of the request."""
    reserved_for: str | None = None
    """Operator with a reservation for the next lease, after a grant."""
    reservation_expires_in_s: float = 0.0
    """Remaining time of the reservation."""


class Refusals(msgspec.Struct, frozen=True):
    """Requests that the robot would refuse now, with the reason it would reply.

    Null means accepted. The reasons apply to the lease holder, or to all operators if there is no
    lease.
    """

    lease: str | None = None
    """Acquiring the lease without a take-over, for operators without a reservation."""
    no_lease: str = ""
    """All requests below, for operators without the lease."""
    arm: str | None = None
    disarm: str | None = None
    reset: str | None = None
    drive: str | None = None
    """Reason why a fresh non-zero command would not move the robot; commands get no reply."""
    set_pose: str | None = None
    speed: str | None = None
    """Setting the speed of continuously spinning wheels."""
    why: Mapping[str, Reason] = {}
    """Code and parameters of each refusal above, by its field."""

    @staticmethod
    def of(why: Mapping[str, Reason | None]) -> Refusals:
        """Create refusals from reasons by field, None for accepted requests."""
        reasons = {field: reason for field, reason in why.items() if reason is not None}
        return Refusals(
            **{field: sentence(reason) for field, reason in reasons.items()}, why=reasons
        )


class DropCounts(msgspec.Struct):
    """Counts of dropped commands, each under one reason."""

    stale: int = 0
    lease: int = 0
    order: int = 0
    nonfinite: int = 0
    key: int = 0
    shape: int = 0


class CommandStatus(msgspec.Struct, frozen=True):
    """Latest accepted command and drop counts."""

    seq: int = 0
    """Sequence number of the latest accepted command."""
    age_s: float | None = None
    """Time since the latest accepted command, or null."""
    echo_s: float | None = None
    """Age of the status echoed by the latest accepted command (round trip)."""
    accepted: int = 0
    dropped: DropCounts = msgspec.field(default_factory=DropCounts)


class LimitStatus(msgspec.Struct, frozen=True):
    """Active limits and the applied fraction of the request."""

    speed_mps: float = 0.0
    turn_rate_rad_per_s: float = 0.0
    max_command_age_s: float = 0.0
    stop_allowance_m: float = 0.0
    """Stopping distance from this speed after any link failure."""
    applied: float = 1.0
    """Fraction of the requested twist applied within the limits."""
    reason: str = ""
    """Reason for reduced limits, or ""."""
    why: tuple[Reason, ...] = ()
    """Codes and parameters behind `reason`."""


class ConsistencyStatus(msgspec.Struct, frozen=True):
    """Consistency of the measured joints: forward-kinematics residual and suspect."""

    residual_mps: float = 0.0
    suspect: str | None = None
    """Suspected module, or null below the threshold."""
    level: float = 0.0
    """Chi-square of the residual relative to its threshold; significant from 1."""
    contributions: Mapping[str, float] = {}
    """Fraction of `level` explained by each module alone."""


class WheelSpeedStatus(msgspec.Struct, frozen=True):
    """Requested and actual speed of continuously spinning wheels."""

    requested_rpm: float
    spin_rpm: float
    """Mean wheel speed, measured or from the motor model."""


class PoseSensorDrops(msgspec.Struct):
    """Counts of dropped pose measurements, each under one reason."""

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
    """Statistics of pose measurements: used, dropped, delay and relocalizations."""

    hz: float = 0.0
    """Number of measurements used in the last second."""
    latency_s: float | None = None
    """Delay of the latest used measurement, or null if none in the last second."""
    used: int = 0
    found: int = 0
    """Number of relocalizations."""
    dropped: PoseSensorDrops = msgspec.field(default_factory=PoseSensorDrops)


class BiasStatus(msgspec.Struct, frozen=True):
    """Estimated bias, in the unit of its name."""

    value: float
    sigma: float


class LoopStatus(msgspec.Struct, frozen=True):
    """Control-loop timing: rate, overruns, jitter and longest period."""

    hz: float = 0.0
    overruns: int = 0
    jitter_p99_ms: float = 0.0
    longest_ms: float = 0.0


class ArmingStatus(msgspec.Struct, frozen=True):
    """Arming progress (0 to 1) in `hold` (neutral tilt, zero throttle) or `spin_up`."""

    phase: str
    progress: float


class RobotStatus(msgspec.Struct, frozen=True):
    """`state/status`."""

    mode: str
    stop_reason: str = ""
    stops: int = 0
    """Number of controlled stops initiated by the robot; reveals even very short ones."""
    stop: Reason | None = None
    """Code and parameters behind `stop_reason`."""
    arming: ArmingStatus | None = None
    lease: LeaseStatus = LeaseStatus()
    refusals: Refusals | None = None
    """Null if the robot does not send it."""
    command: CommandStatus = CommandStatus()
    limits: LimitStatus = LimitStatus()
    consistency: ConsistencyStatus = ConsistencyStatus()
    wheel_speed: WheelSpeedStatus | None = None
    """Only for robots with wheels that spin at rest."""
    pose_sensor: PoseSensorStatus | None = None
    """Null until the first pose measurement arrives."""
    learned: Mapping[str, BiasStatus] | None = None
    """Estimated biases by name, or null before a measurement reveals any."""
    loop: LoopStatus = LoopStatus()
    hardware: Mapping[str, Any] = {}
    operators: Mapping[str, str] = {}
    """Display names by operator id, of up to eight operators; others have no name."""

    @property
    def is_recording(self) -> bool:
        """Whether a replay sends this status; recordings cannot be driven or stopped."""
        return self.hardware.get("kind") == RECORDING

    @property
    def no_drive_reason(self) -> str:
        """The robot's reason for not moving, or its mode if it gives none."""
        return sentence(self.why_no_drive)

    @property
    def why_no_drive(self) -> Reason:
        """Reason why the robot does not move; its mode when it gives none."""
        refusals = self.refusals or Refusals()
        why = refusals.why.get("drive") or text_reason(refusals.drive or "")
        return why or because(Code.MODE_ONLY, mode=self.mode)


def encode_status(status: RobotStatus) -> bytes:
    """Encode a status as JSON."""
    return msgspec.json.encode(status)


def decode_status(payload: bytes) -> RobotStatus:
    """Decode a status from JSON; unknown fields are ignored.

    Raises:
        MessageError: If it is not a status (`shape`).
    """
    status = decode_json(payload, RobotStatus, "a status")
    if _is_deeper(status.hardware, _LEVELS):  # Deep nesting decodes, but may not encode.
        raise MessageError("shape", f"hardware is nested in more than {_LEVELS} levels")
    return _with_reasons(status)


def _with_reasons(status: RobotStatus) -> RobotStatus:
    """Return a status in which each text has a reason; robots without codes send texts only."""
    refusals, limits = status.refusals, status.limits
    if refusals is not None and not refusals.why and refusals.no_lease:
        texts = {field: getattr(refusals, field) for field in _REFUSED}
        why = {field: reason for field, text in texts.items() if (reason := text_reason(text))}
        refusals = msgspec.structs.replace(refusals, why=why)
    if limits.reason and not limits.why:
        limits = msgspec.structs.replace(limits, why=(Reason(Code.TEXT, {"text": limits.reason}),))
    stop = status.stop or text_reason(status.stop_reason)
    if refusals is status.refusals and limits is status.limits and stop is status.stop:
        return status
    return msgspec.structs.replace(status, refusals=refusals, limits=limits, stop=stop)


class Summary(msgspec.Struct, frozen=True):
    """`state/summary`: the current message of each stream, for whoever follows no stream."""

    status_seq: int
    """Number of the `state/status` in it."""
    payloads: Mapping[str, bytes]
    """Payloads by topic, such as `state/odom`."""


def encode_summary(summary: Summary) -> bytes:
    """Encode a summary as MessagePack."""
    return msgspec.msgpack.encode(summary)


def decode_summary(payload: bytes) -> Summary:
    """Decode a summary from MessagePack.

    Raises:
        MessageError: If it is not a summary (`shape`).
    """
    try:
        return msgspec.msgpack.decode(payload, type=Summary)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError("shape", f"not a summary: {error}") from error


_REFUSED = tuple(field for field in Refusals.__struct_fields__ if field != "why")


def encode_stamp(seq: int, robot_ns: int) -> bytes:
    """Encode the attachment of a `state/*` message: its number and the robot's monotonic time."""
    return _STAMP.pack(seq, robot_ns)


def decode_stamp(attachment: bytes) -> tuple[int, int]:
    """Decode an attachment into (seq, robot_ns).

    Raises:
        MessageError: If the attachment is invalid (`shape`).
    """
    try:
        return _STAMP.unpack(attachment)
    except struct.error as error:
        raise MessageError("shape", f"stamp: {error}") from error


def _is_deeper(value: Any, levels: int) -> bool:
    """Return whether a JSON value is nested deeper than `levels`."""
    if not isinstance(value, dict | list):
        return False
    inside = cast("Any", value)
    parts = inside.values() if isinstance(value, dict) else inside
    return levels <= 0 or any(_is_deeper(part, levels - 1) for part in parts)
