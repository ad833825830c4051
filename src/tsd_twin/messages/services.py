"""Requests to the services of a robot, their replies, and events, as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import msgspec
from msgspec import Meta

from tsd_twin.errors import MessageError

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


def duplicate_id_text(robot_id: str) -> str:
    """Error text for several robots with one id."""
    return f"another robot with the id '{robot_id}' is on the bus: end one, or choose another id"


def to_builtins(message: msgspec.Struct) -> Mapping[str, Any]:
    """Message as plain dicts and lists."""
    return msgspec.to_builtins(message)
