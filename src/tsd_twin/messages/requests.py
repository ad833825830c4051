"""What clients send to a robot, and its replies: velocity commands, poses, requests to services.

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
from tsd_twin.messages.ros import BASE, ODOM, TwistStamped, decode_twist, wrapped_heading
from tsd_twin.messages.topics import Service

_ATTACHMENT = struct.Struct("<Q16sQ")
_PAYLOADS_KEPT = 16


@dataclass(frozen=True, slots=True)
class Sample:
    """Unchecked sample from the bus: key, payload and attachment."""

    key: str
    payload: bytes
    attachment: bytes
    is_put: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """A decoded velocity command; the command gate decides whether it counts."""

    operator: str
    seq: int
    lease: bytes
    status_seq: int
    """Sequence number of the newest received status: bounds the age without a common clock."""
    frame: str
    """`base_link` or `odom`."""
    twist: Array
    """(6,): spatial, finite."""


def encode_attachment(seq: int, lease: bytes, status_seq: int) -> bytes:
    """Attachment of a command: its number, its lease, the newest received status."""
    return _ATTACHMENT.pack(seq, lease, status_seq)


def decode_command(sample: Sample) -> Command:
    """Command in a sample of `twin/<robot>/cmd/<operator>/twist`.

    Raises:
        MessageError: the reason is one of `key`, `shape` and `nonfinite`.
    """
    parts = sample.key.split("/")
    if not sample.is_put or len(parts) != 5 or "*" in sample.key:
        raise MessageError("key", f"{sample.key} is not the key of one operator")
    try:
        seq, lease, status_seq = _ATTACHMENT.unpack(sample.attachment)
    except struct.error as error:
        raise MessageError("shape", f"attachment: {error}") from error
    message = _checked_twist(sample.payload)
    return Command(parts[3], seq, lease, status_seq, message.frame, message.twist)


@functools.lru_cache(maxsize=_PAYLOADS_KEPT)
def _checked_twist(payload: bytes) -> TwistStamped:
    """Return the twist in a payload, which nothing can change: a motion repeats it at 50 Hz."""
    message = decode_twist(payload)
    if message.frame not in (BASE, ODOM):
        raise MessageError("shape", f"frame_id must be {BASE} or {ODOM}")
    if not np.isfinite(message.twist).all():
        raise MessageError("nonfinite", "a twist must be finite numbers")
    message.twist.setflags(write=False)
    return message


_LENGTH_OFF = 1e-3
"""Tolerance of the length of a quaternion; a larger deviation is not rounding."""
_UPRIGHT = math.cos(math.radians(30.0))
"""Largest tilt of a robot that stands on a floor."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseStamped:
    """Spatial pose in `frame`, at the time `stamp_ns` of the robot's wall clock."""

    frame: str
    position_m: Array
    """(3,)."""
    wxyz: Array
    """(4,)."""
    stamp_ns: int

    @staticmethod
    def planar(pose: SE2, stamp_ns: int) -> PoseStamped:
        """Message of a planar pose in `odom`."""
        x, y, heading = pose.xy_heading.tolist()
        turn = [math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)]
        return PoseStamped(ODOM, np.array([x, y, 0.0]), np.array(turn), stamp_ns)


def encode_pose(message: PoseStamped) -> bytes:
    """CDR of a pose."""
    w, x, y, z = message.wxyz
    cdr = CdrWriter()
    cdr.header(message.stamp_ns, message.frame)
    cdr.doubles([*message.position_m, x, y, z, w])
    return cdr.payload()


def decode_pose(payload: bytes) -> PoseStamped:
    """Pose in a CDR payload; numbers may be anything, also NaN.

    Raises:
        MessageError: `shape`, when this is no `geometry_msgs/msg/PoseStamped`.
    """
    cdr = CdrReader(payload, "geometry_msgs/msg/PoseStamped")
    stamp_ns, frame = cdr.header()
    pose = cdr.doubles(7)
    cdr.end()
    return PoseStamped(frame, position_m=pose[:3], wxyz=pose[[6, 3, 4, 5]], stamp_ns=stamp_ns)


def decode_pose_measurement(sample: Sample) -> tuple[SE2, int]:
    """Pose on the floor, and its stamp, in a sample of `twin/<robot>/sensor/pose`.

    Heading in (-pi, pi]; height and a small lean are left out.

    Raises:
        MessageError: the reason is one of `key`, `shape`, `frame`, `nonfinite` and `quaternion`.
    """
    if not sample.is_put or "*" in sample.key:
        raise MessageError("key", f"{sample.key} is not the key of one robot")
    message = decode_pose(sample.payload)
    if message.frame != ODOM:
        raise MessageError("frame", f"frame_id must be {ODOM}")
    if not (np.isfinite(message.position_m).all() and np.isfinite(message.wxyz).all()):
        raise MessageError("nonfinite", "a pose must be finite numbers")
    w, x, y, z = message.wxyz.tolist()
    # hypot does not overflow; squares would.
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
"""Text of bounded length, since it may be part of every status for a long time."""
StructT = TypeVar("StructT", bound=msgspec.Struct)
RequestT = TypeVar("RequestT", bound="Request")


class Request(msgspec.Struct, frozen=True):
    """Base class of requests, which are JSON objects."""


class LeaseRequest(Request, frozen=True, kw_only=True):
    """`srv/lease`: `acquire`, `renew` and `release` the lease, or `peek` at its holder.

    `request` asks the holder for it, until `withdraw`; the holder answers with `grant` or `deny`.
    """

    op: Literal["acquire", "renew", "release", "peek", "request", "withdraw", "grant", "deny"]
    operator: Operator
    lease: LeaseId | None = None
    """Id of the lease, for the holder's operations: renew, release, grant and deny."""
    asker: Operator | None = None
    """Operator whose request is answered, for grant and deny."""
    take_over: bool = False
    """Acquire the lease although another operator holds it; the holder is notified."""
    reason: ShortText = ""
    """Reason of a take-over, published as an event."""
    max_age_s: Annotated[float, Meta(gt=0.0)] | None = None
    """Requested maximum age of commands, for slow links; the speed limit shrinks with it."""


class HolderRequest(Request, frozen=True):
    """`srv/arm`, `srv/disarm`, `srv/reset`: requests reserved for the holder of the lease."""

    lease: LeaseId


class SetPoseRequest(Request, frozen=True):
    """`srv/set_pose`: new pose of the estimate, in `odom`."""

    lease: LeaseId
    x_m: float
    y_m: float
    heading_rad: float


class SetOrientationRequest(Request, frozen=True):
    """`srv/set_pose` of a sphere: new orientation; the identity unless given."""

    lease: LeaseId
    xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion of any length, as in `geometry_msgs/msg/Quaternion`."""


class SpeedRequest(Request, frozen=True):
    """`srv/speed`: speed of wheels that always spin."""

    lease: LeaseId
    cruise_speed_rpm: float


class StopRequest(Request, frozen=True):
    """`stop`: allowed to every client; all fields are optional."""

    operator: ShortText = ""
    reason: ShortText = ""


class LeaseReply(msgspec.Struct, frozen=True):
    """Answer of `srv/lease`."""

    granted: bool
    lease: str | None = None
    holder: str | None = None
    ttl_s: float = 0.0
    reason: str = ""
    max_age_s: float = 0.0
    """Age up to which commands count under this lease."""
    ok: bool = True
    """False when the request could not be read."""
    done: bool = False
    """Whether the request was carried out, also for operations that grant no lease."""


class Reply(msgspec.Struct, frozen=True):
    """Answer of all other services."""

    ok: bool
    reason: str = ""


class Event(msgspec.Struct, frozen=True):
    """`event/<kind>`: an event for operators and logs."""

    kind: str
    text: str
    """One sentence."""
    requested: Any = None
    applied: Any = None
    rule: str = ""
    """The rule that was applied."""
    robot_s: float = 0.0
    """The robot's monotonic clock."""


class Description(msgspec.Struct, frozen=True):
    """Answer of `desc`."""

    robot: str
    """TOML text."""
    urdf: str


def decode_request(payload: bytes, kind: type[RequestT]) -> RequestT:
    """Request in a payload.

    Raises:
        MessageError: `shape`, with what is missing or wrong.
    """
    return decode_json(payload or b"{}", kind, "a request")


def decode_json(payload: bytes, kind: type[StructT], what: str) -> StructT:
    """Decode a JSON payload to a `kind`; `what` names the expected message in the error.

    Raises:
        MessageError: `shape`, with what is missing or wrong.
    """
    try:
        return msgspec.json.decode(payload, type=kind)
    # Text that is not UTF-8 and thousands of brackets are not among the errors of msgspec.
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError("shape", f"not {what}: {error}") from error


def encode_refusal(service: Service, reason: str) -> bytes:
    """JSON of a reply that refuses a request to a service."""
    if service is Service.LEASE:
        return msgspec.json.encode(LeaseReply(False, reason=reason))
    return msgspec.json.encode(Reply(False, reason))


def duplicate_id_text(robot_id: str) -> str:
    """Error text for several robots with one id."""
    return f"another robot with the id '{robot_id}' is on the bus: end one, or choose another id"


def to_builtins(message: msgspec.Struct) -> Mapping[str, Any]:
    """Message as plain dicts and lists."""
    return msgspec.to_builtins(message)
