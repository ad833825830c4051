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
"""Goes into every status for as long as it is true."""
StructT = TypeVar("StructT", bound=msgspec.Struct)
RequestT = TypeVar("RequestT", bound="Request")


class Request(msgspec.Struct, frozen=True):
    """Any request: a JSON object."""


class LeaseRequest(Request, frozen=True, kw_only=True):
    """`srv/lease`: `acquire`, `renew` and `release` the right to drive, or `peek` who has it.

    `request` asks the holder for it, until `withdraw`; the holder answers with `grant` or `keep`.
    """

    op: Literal["acquire", "renew", "release", "peek", "request", "withdraw", "grant", "deny"]
    operator: Operator
    lease: LeaseId | None = None
    """For what only the holder may: renew, release, grant and keep."""
    asker: Operator | None = None
    """For grant and keep: whose request is answered."""
    take_over: bool = False
    """Acquire it even though another holds it; the holder sees that."""
    reason: ShortText = ""
    """Why it is taken over, for all to see."""
    max_age_s: Annotated[float, Meta(gt=0.0)] | None = None
    """Age up to which commands shall count, for far links; the speed cap shrinks with it."""


class HolderRequest(Request, frozen=True):
    """`srv/arm`, `srv/disarm`, `srv/reset`: what only the holder of the lease may ask."""

    lease: LeaseId


class SetPoseRequest(Request, frozen=True):
    """`srv/set_pose`: where the robot is, in `odom`."""

    lease: LeaseId
    x_m: float
    y_m: float
    heading_rad: float


class SetOrientationRequest(Request, frozen=True):
    """`srv/set_pose` of a sphere: how it is turned; upright unless a quaternion is given."""

    lease: LeaseId
    xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion of any length, as in `geometry_msgs/msg/Quaternion`."""


class SpeedRequest(Request, frozen=True):
    """`srv/speed`: how fast wheels that always spin shall turn."""

    lease: LeaseId
    cruise_speed_rpm: float


class StopRequest(Request, frozen=True):
    """`stop`: anybody may; all fields can be left out."""

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
    """What was asked for has happened, also where that grants no lease to who asked for it."""


class Reply(msgspec.Struct, frozen=True):
    """Answer of all other services."""

    ok: bool
    reason: str = ""


class Event(msgspec.Struct, frozen=True):
    """`event/<kind>`: something that an operator or a log wants to know."""

    kind: str
    text: str
    """One sentence."""
    requested: Any = None
    applied: Any = None
    rule: str = ""
    """The rule that made the difference."""
    robot_s: float = 0.0
    """The robot's monotonic clock."""


class Description(msgspec.Struct, frozen=True):
    """Answer of `desc`."""

    robot: str
    """TOML text."""
    urdf: str


def decode_request(payload: bytes, kind: type[RequestT]) -> RequestT:
    """Return the request in a payload.

    Raises:
        MessageError: `shape`, with what is missing or wrong.
    """
    return decode_json(payload or b"{}", kind, "a request")


def decode_json(payload: bytes, kind: type[StructT], what: str) -> StructT:
    """Return the `kind` in a JSON payload; `what` is what the error says that it is not.

    Raises:
        MessageError: `shape`, with what is missing or wrong.
    """
    try:
        return msgspec.json.decode(payload, type=kind)
    # Text that is not UTF-8 and thousands of brackets are not among the errors of msgspec.
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError("shape", f"not {what}: {error}") from error


def duplicate_id_text(robot_id: str) -> str:
    """Return what is wrong with a bus that has several robots of one id."""
    return f"another robot with the id '{robot_id}' is on the bus: end one, or choose another id"


def to_builtins(message: msgspec.Struct) -> Mapping[str, Any]:
    """Return a message as plain dicts and lists."""
    return msgspec.to_builtins(message)
