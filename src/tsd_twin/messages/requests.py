"""Client messages to a robot (velocity commands, poses, service requests) and its replies.

Commands carry lease and sequence numbers as an attachment; requests, replies and events are JSON.
"""

from __future__ import annotations

import functools
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from tsd_twin.errors import MessageError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr_codec import CdrReader, CdrWriter
from tsd_twin.messages.codes import Code, Reason, because, text_reason
from tsd_twin.messages.errors import RejectedMessage
from tsd_twin.messages.ros import BASE, ODOM, TwistStamped, decode_twist, wrapped_heading
from tsd_twin.messages.sentences import full_sentence, sentence
from tsd_twin.messages.topics import Service

_ATTACHMENT = struct.Struct("<Q16sQ")
_PAYLOADS_KEPT = 16


@dataclass(frozen=True, slots=True)
class Sample:
    """Unvalidated bus sample: key, payload and attachment."""

    key: str
    payload: bytes
    attachment: bytes
    is_put: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """Decoded velocity command, before validation by the command gate."""

    operator: str
    seq: int
    lease: bytes
    status_seq: int
    """Latest received status number; bounds the age without synchronized clocks."""
    frame: str
    """`base_link` or `odom`."""
    twist: Array
    """(6,): spatial twist, finite."""


def encode_attachment(seq: int, lease: bytes, status_seq: int) -> bytes:
    """Encode a command attachment: sequence number, lease and latest received status."""
    return _ATTACHMENT.pack(seq, lease, status_seq)


def decode_command(sample: Sample) -> Command:
    """Decode a sample of `twin/<robot>/cmd/<operator>/twist`.

    Raises:
        MessageError: With reason `key`, `shape` or `nonfinite`.
    """
    parts = sample.key.split("/")
    if not sample.is_put or len(parts) != 5 or "*" in sample.key:
        raise RejectedMessage("key", because(Code.BAD_KEY, key=sample.key))
    try:
        seq, lease, status_seq = _ATTACHMENT.unpack(sample.attachment)
    except struct.error as error:
        raise MessageError("shape", f"attachment: {error}") from error
    message = _checked_twist(sample.payload)
    return Command(parts[3], seq, lease, status_seq, message.frame, message.twist)


@functools.lru_cache(maxsize=_PAYLOADS_KEPT)
def _checked_twist(payload: bytes) -> TwistStamped:
    """Decode an immutable twist; cached because motions repeat it at 50 Hz."""
    message = decode_twist(payload)
    if message.frame not in (BASE, ODOM):
        raise MessageError("shape", f"frame_id must be {BASE} or {ODOM}")
    if not np.isfinite(message.twist).all():
        raise RejectedMessage("nonfinite", because(Code.NOT_FINITE, quantity="twist"))
    message.twist.setflags(write=False)
    return message


_LENGTH_OFF = 1e-3
"""Tolerance on quaternion length, above rounding errors."""
_UPRIGHT = math.cos(math.radians(30.0))
"""Maximum tilt of a robot on a floor."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseStamped:
    """Spatial pose in `frame`, at `stamp_ns` of the robot's wall clock."""

    frame: str
    position_m: Array
    """(3,)."""
    wxyz: Array
    """(4,)."""
    stamp_ns: int

    @staticmethod
    def planar(pose: SE2, stamp_ns: int) -> PoseStamped:
        """Return the message for a planar pose in `odom`."""
        x, y, heading = pose.xy_heading.tolist()
        turn = [math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)]
        return PoseStamped(ODOM, np.array([x, y, 0.0]), np.array(turn), stamp_ns)


def encode_pose(message: PoseStamped) -> bytes:
    """Encode a pose as CDR."""
    w, x, y, z = message.wxyz
    cdr = CdrWriter()
    cdr.header(message.stamp_ns, message.frame)
    cdr.doubles([*message.position_m, x, y, z, w])
    return cdr.payload()


def decode_pose(payload: bytes) -> PoseStamped:
    """Decode a pose from CDR; values may be NaN.

    Raises:
        MessageError: If it is not a `geometry_msgs/msg/PoseStamped` (`shape`).
    """
    cdr = CdrReader(payload, "geometry_msgs/msg/PoseStamped")
    stamp_ns, frame = cdr.header()
    pose = cdr.doubles(7)
    cdr.end()
    return PoseStamped(frame, position_m=pose[:3], wxyz=pose[[6, 3, 4, 5]], stamp_ns=stamp_ns)


def decode_pose_measurement(sample: Sample) -> tuple[SE2, int]:
    """Decode a sample of `twin/<robot>/sensor/pose`; return the planar pose and its stamp.

    The heading is in (-pi, pi]; height and small tilt are ignored.

    Raises:
        MessageError: With reason `key`, `shape`, `frame`, `nonfinite` or `quaternion`.
    """
    if not sample.is_put or "*" in sample.key:
        raise MessageError("key", f"{sample.key} is not the key of one robot")
    message = decode_pose(sample.payload)
    if message.frame != ODOM:
        raise MessageError("frame", f"frame_id must be {ODOM}")
    if not (np.isfinite(message.position_m).all() and np.isfinite(message.wxyz).all()):
        raise MessageError("nonfinite", "a pose must be finite numbers")
    w, x, y, z = message.wxyz.tolist()
    # Squares would overflow, but hypot does not.
    if abs(math.hypot(w, x, y, z) - 1.0) > _LENGTH_OFF:
        raise MessageError("quaternion", "the length of a quaternion must be one")
    if 1.0 - 2.0 * (x * x + y * y) < _UPRIGHT:
        raise MessageError("quaternion", "a robot on a floor stands upright")
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    x_m, y_m, _ = message.position_m
    return SE2(wrapped_heading(np.array([x_m, y_m, heading]))), message.stamp_ns


LeaseId: TypeAlias = Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
Operator: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}\Z")]
ShortText: TypeAlias = Annotated[str, Meta(max_length=200)]
"""Bounded length, because it may be repeated in every status."""
StructT = TypeVar("StructT", bound=msgspec.Struct)
RequestT = TypeVar("RequestT", bound="Request")


class Request(msgspec.Struct, frozen=True):
    """Base class of JSON requests."""


class LeaseRequest(Request, frozen=True, kw_only=True):
    """`srv/lease`: `acquire`, `renew` or `release` the lease, or `peek` at its holder.

    `request` asks the holder for it, until `withdraw`; the holder responds with `grant` or `deny`.
    """

    op: Literal["acquire", "renew", "release", "peek", "request", "withdraw", "grant", "deny"]
    operator: Operator
    lease: LeaseId | None = None
    """Lease id, required for renew, release, grant and deny."""
    asker: Operator | None = None
    """Requester addressed by grant or deny."""
    take_over: bool = False
    """Acquire the lease even if another operator holds it; the holder is notified."""
    reason: ShortText = ""
    """Reason for a take-over, published as an event."""
    max_age_s: Annotated[float, Meta(gt=0.0)] | None = None
    """Requested maximum command age for slow links; lowers the speed limit."""


class HolderRequest(Request, frozen=True):
    """`srv/arm`, `srv/disarm`, `srv/reset`: requests that require the lease."""

    lease: LeaseId


class SetPoseRequest(Request, frozen=True):
    """`srv/set_pose`: new pose estimate in `odom`."""

    lease: LeaseId
    x_m: float
    y_m: float
    heading_rad: float


class SetOrientationRequest(Request, frozen=True):
    """`srv/set_pose` for a sphere: new orientation, by default the identity."""

    lease: LeaseId
    xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion, not necessarily normalized, as in `geometry_msgs/msg/Quaternion`."""


class SpeedRequest(Request, frozen=True):
    """`srv/speed`: speed of continuously spinning wheels."""

    lease: LeaseId
    cruise_speed_rpm: float


class StopRequest(Request, frozen=True):
    """`stop`: open to all clients; all fields are optional."""

    operator: ShortText = ""
    reason: ShortText = ""


class LeaseReply(msgspec.Struct, frozen=True):
    """Reply of `srv/lease`."""

    granted: bool
    lease: str | None = None
    holder: str | None = None
    ttl_s: float = 0.0
    reason: str = ""
    max_age_s: float = 0.0
    """Maximum age of accepted commands under this lease."""
    ok: bool = True
    """False if the request was malformed."""
    done: bool = False
    """Whether the request was carried out, also for operations that grant no lease."""
    why: Reason | None = None
    """Code and parameters behind `reason`."""


class Reply(msgspec.Struct, frozen=True):
    """Reply of all other services."""

    ok: bool
    reason: str = ""
    why: Reason | None = None
    """Code and parameters behind `reason`."""

    @staticmethod
    def refused(why: Reason) -> Reply:
        """Refusal for a reason."""
        return Reply(False, sentence(why), why)


class Event(msgspec.Struct, frozen=True):
    """`event/<kind>`: event for operators and logs."""

    kind: str
    text: str
    """Single sentence."""
    requested: Any = None
    applied: Any = None
    rule: str = ""
    """Rule that was applied."""
    robot_s: float = 0.0
    """Robot's monotonic time."""
    why: Reason | None = None
    """Code and parameters behind `text`."""

    @staticmethod
    def of(
        kind: str,
        why: Reason,
        rule: str,
        robot_s: float,
        requested: Any = None,
        applied: Any = None,
    ) -> Event:
        """Event for a reason."""
        return Event(kind, full_sentence(why), requested, applied, rule, robot_s, why)


class Description(msgspec.Struct, frozen=True):
    """Reply of `desc`."""

    robot: str
    """Description as TOML."""
    urdf: str


def decode_request(payload: bytes, kind: type[RequestT]) -> RequestT:
    """Decode a request.

    Raises:
        MessageError: If a field is missing or invalid (`shape`).
    """
    return decode_json(payload or b"{}", kind, "a request")


def decode_json(payload: bytes, kind: type[StructT], what: str) -> StructT:
    """Decode a JSON payload as `kind`; `what` names it in errors.

    Raises:
        MessageError: If a field is missing or invalid (`shape`).
    """
    try:
        return msgspec.json.decode(payload, type=kind)
    # msgspec raises other errors for invalid UTF-8 and deep nesting.
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError("shape", f"not {what}: {error}") from error


def encode_refusal(service: Service, why: Reason) -> bytes:
    """Encode a reply that refuses a service request."""
    if service is Service.LEASE:
        return msgspec.json.encode(LeaseReply(False, reason=sentence(why), why=why))
    return msgspec.json.encode(Reply.refused(why))


def why_of(message: Reply | LeaseReply | Event) -> Reason | None:
    """Reason in a message; a robot without codes sends only its text."""
    return message.why or text_reason(
        message.text if isinstance(message, Event) else message.reason
    )


def duplicate_id_text(robot_id: str) -> str:
    """Return the error text for several robots with the same id."""
    return sentence(because(Code.DUPLICATE_ID, robot=robot_id))


def to_builtins(message: msgspec.Struct) -> Mapping[str, Any]:
    """Convert a message to plain dicts and lists."""
    return msgspec.to_builtins(message)
